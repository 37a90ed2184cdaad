"""Meshes from files: units, colours and parts of real formats; broken and hostile files end with one error."""

import builtins
import json
import os
import struct

import numpy as np
import pytest
import trimesh
from peers.real_robots import ROBOTS

from robot_dynamics import InvalidInputError
from robot_dynamics.viewing import mesh_loading
from robot_dynamics.viewing.mesh_loading import load_mesh
from robot_dynamics.viewing.mesh_sizes import MAX_FACES

SECRET = "SECRET-CONTENT"
DAE = """<?xml version="1.0" encoding="{encoding}"?>{doctype}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="x" meter="{unit}"/><up_axis>Y_UP</up_axis></asset>
{libraries}
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="9">0 0 0 1 0 0 0 2 3</float_array><technique_common>
<accessor source="#f" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
{primitive}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene">{scene}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>"""
TRIANGLES = (
    '<triangles count="1" material="m"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>'
)
POLYLIST = (
    '<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>{}</vcount><p>0 1 2</p></polylist>'
)
NODE = '<node id="n"><matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node>'
TEXTURE = """<library_images><image id="i"><init_from>{}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="surface"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="sampler"><sampler2D><source>surface</source></sampler2D></newparam>
<technique sid="t"><phong><diffuse><texture texture="sampler" texcoord="UV"/></diffuse></phong></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="mm"><instance_effect url="#e"/></material></library_materials>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
BOUND = '<node id="n"><instance_geometry url="#g"><bind_material><technique_common>' + (
    '<instance_material symbol="m" target="#mm"/></technique_common></bind_material></instance_geometry></node>'
)


def dae(scene=NODE, libraries="", primitive=TRIANGLES, doctype="", unit="1", encoding="utf-8"):
    text = DAE.format(**locals())
    return text.encode(encoding)


def glb(header, binary=bytes(4)):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf_header(**changes):
    """The header of a triangle whose vertices are in no buffer."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 4}]}],
        "accessors": vertices(3),
        "buffers": [{"byteLength": 4}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 4}],
        **changes,
    }


def vertices(count):
    """The accessors of vertices that are in no buffer, so that a reader takes zeros."""
    return [{"count": count, "componentType": 5126, "type": "VEC3"}]


def write(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb", ".dae", ".STL"])
def test_every_format_is_read(suffix, tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    path = write(tmp_path, f"box{suffix}", box.export(file_type=suffix[1:].lower()))
    mesh = load_mesh(path)
    assert len(mesh.faces) == 12
    np.testing.assert_allclose(mesh.bounds, [[-0.5, -1, -1.5], [0.5, 1, 1.5]], atol=1e-7)
    assert mesh.volume == pytest.approx(6)


def test_text_stl_is_read(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    mesh = load_mesh(write(tmp_path, "box.stl", box.export(file_type="stl_ascii")))
    assert len(mesh.faces) == 12 and len(mesh.vertices) == 8


def test_collada_is_in_metres_and_its_up_axis_is_ignored(tmp_path):
    mesh = load_mesh(write(tmp_path, "a.dae", dae(unit="0.01")))
    np.testing.assert_allclose(mesh.bounds, [[0.05, 0, 0], [0.06, 0.02, 0.03]], atol=1e-12)


def test_colours_of_collada_are_kept():
    mesh = load_mesh(ROBOTS / "anymal_c_simple_description" / "meshes" / "base.dae")
    assert len(np.unique(mesh.visual.face_colors, axis=0)) == 6


def face_colours(mesh):
    return [tuple(int(value) for value in colour[:3]) for colour in mesh.visual.face_colors]


def test_colours_of_a_material_library_beside_an_obj_are_kept(tmp_path):
    write(tmp_path, "a.mtl", "newmtl red\nKd 1 0 0\nmap_Kd secret.png\nnewmtl blue\nKd 0 0 0.5\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 3 2 1\n"
    mesh = load_mesh(write(tmp_path, "a.obj", text))
    assert sorted(face_colours(mesh)) == [(0, 0, 128), (255, 0, 0)]


@pytest.mark.parametrize("name", ["../outside.mtl", "link.mtl", "/etc/a.mtl", "missing.mtl", "large.mtl"])
def test_other_material_libraries_are_left_out(name, tmp_path):
    folder = tmp_path / "package"
    folder.mkdir()
    outside = write(tmp_path, "outside.mtl", "newmtl red\nKd 1 0 0\n")
    (folder / "link.mtl").symlink_to(outside)
    write(folder, "large.mtl", "newmtl red\nKd 1 0 0\n" + "#" * 1_100_000)
    mesh = load_mesh(write(folder, "a.obj", f"mtllib {name}\nusemtl red\n" + OBJ))
    assert len(mesh.faces) == 1 and (255, 0, 0) not in face_colours(mesh)


def test_base_colours_of_gltf_are_kept(tmp_path):
    """0.21586 of the light of white is 0.5 of its value in sRGB."""
    header = gltf_header(
        materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.21586, 0, 1]}}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 4, "material": 0}]}],
    )
    assert face_colours(load_mesh(write(tmp_path, "a.glb", glb(header)))) == [(255, 128, 0)]


def test_instances_of_collada_are_parts(tmp_path):
    scene = NODE + '<node id="k"><scale>2 2 2</scale><instance_node url="#l"/></node>'
    libraries = '<library_nodes><node id="l"><instance_geometry url="#g"/></node></library_nodes>'
    mesh = load_mesh(write(tmp_path, "a.dae", dae(scene, libraries)))
    assert len(mesh.faces) >= 1
    np.testing.assert_allclose(mesh.bounds[1, 0], 6)


def test_geometry_whose_texture_is_missing_is_kept(tmp_path):
    libraries = TEXTURE[TEXTURE.index("<library_effects>") :]
    assert len(load_mesh(write(tmp_path, "a.dae", dae(BOUND, libraries))).faces) == 1


OPENED = {
    "texture of .dae": (".dae", lambda path: dae(BOUND, TEXTURE.format(path))),
    "relative texture of .dae": (".dae", lambda path: dae(BOUND, TEXTURE.format("./secret.png"))),
    "library of .obj": (
        ".obj",
        lambda path: f"mtllib {path}\nmtllib secret.png\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3",
    ),
    "texture of .ply": (
        ".ply",
        lambda path: (
            f"ply\nformat ascii 1.0\ncomment TextureFile {path}\nelement vertex 3\nproperty float x\n"
            "property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\n"
            "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        ),
    ),
    "image of .glb": (
        ".glb",
        lambda path: glb(
            gltf_header(
                images=[{"uri": str(path)}],
                textures=[{"source": 0}],
                materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
                meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 4, "material": 0}]}],
            )
        ),
    ),
}


@pytest.mark.parametrize("case", OPENED)
def test_files_that_a_mesh_refers_to_are_not_opened(case, tmp_path, monkeypatch):
    suffix, content = OPENED[case]
    secret = write(tmp_path, "secret.png", SECRET)
    path = write(tmp_path, f"mesh{suffix}", content(secret))
    assert len(load_mesh(path).faces) == 1
    opened = []
    original, original_open = builtins.open, os.open
    monkeypatch.setattr(builtins, "open", lambda file, *a, **k: opened.append(str(file)) or original(file, *a, **k))
    monkeypatch.setattr(os, "open", lambda file, *a, **k: opened.append(str(file)) or original_open(file, *a, **k))
    load_mesh(path)
    assert [name for name in opened if name.startswith(str(tmp_path))] == [str(path)]


ENTITY = '<!DOCTYPE a [<!ENTITY e SYSTEM "file://{}">]>'
LAUGHS = (
    "<!DOCTYPE a ["
    + '<!ENTITY a0 "ha">'
    + "".join(f'<!ENTITY a{k + 1} "&a{k};&a{k};&a{k};&a{k};&a{k};&a{k};&a{k};&a{k};&a{k};&a{k};">' for k in range(9))
    + "]>"
)
NODE_60 = NODE.replace('id="n"', 'id="n60"')
DOUBLED = "".join(
    f'<node id="n{k}"><instance_node url="#n{k + 1}"/><instance_node url="#n{k + 1}"/></node>' for k in range(60)
)
DOUBLED = f"<library_nodes>{DOUBLED}{NODE_60}</library_nodes>"
HOSTILE = {
    "entity": (".dae", dae(NODE.replace('"n"', '"&e;"'), doctype=ENTITY.format("/etc/passwd"))),
    "entity in UTF-16": (".dae", dae(NODE, doctype=ENTITY.format("/etc/passwd"), encoding="utf-16")),
    "laughs": (".dae", dae(f'<node id="n" name="&a9;">{NODE}</node>', doctype=LAUGHS)),
    "document type of another file": (".dae", dae(doctype='<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd">')),
    "nodes without end": (".dae", dae('<node id="n"><instance_node url="#n"/></node>')),
    "nodes doubled sixty times": (".dae", dae('<node><instance_node url="#n0"/></node>', DOUBLED)),
    "nested nodes": (".dae", dae("<node>" * 1500 + NODE + "</node>" * 1500)),
    "polygon of a billion corners": (".dae", dae(primitive=POLYLIST.format(10**9))),
    "negative polygon": (".dae", dae(primitive=POLYLIST.format("-5 8"))),
    "index outside": (".dae", dae(primitive=TRIANGLES.replace("0 1 2", "0 1 99"))),
    "negative index": (".dae", dae(primitive=TRIANGLES.replace("0 1 2", "0 1 -99"))),
    "no geometry": (".dae", dae("")),
    "unit of zero": (".dae", dae(unit="0")),
    "unit of nan": (".dae", dae(unit="nan")),
    "coordinates that are not finite": (".dae", dae().replace(b"0 2 3", b"0 1e999 3")),
    "not a mesh": (".dae", f"<html>{SECRET}</html>".encode()),
    "not XML": (".dae", SECRET.encode()),
    "empty .dae": (".dae", b""),
    "empty .stl": (".stl", b""),
    "text .stl": (".stl", SECRET.encode()),
    "cut .stl": (".stl", trimesh.creation.box().export(file_type="stl")[:200]),
    "count of .stl": (".stl", b" " * 80 + struct.pack("<I", 2**32 - 1) + b" " * 50),
    "empty .obj": (".obj", b""),
    "index outside .obj": (".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
    "words in .obj": (".obj", f"v {SECRET} 0 0\nf 1 1 1\n".encode()),
    "count of .ply": (
        ".ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\n"
        b"property float z\nend_header\n" + b" " * 36,
    ),
    "count of text .ply": (
        ".ply",
        b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nelement face 99999999999\n"
        b"property list uchar int vertex_indices\nend_header\n0\n3 0 0 0\n",
    ),
    "list of .ply": (
        ".ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
        b"property float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uint int vertex_indices\nend_header\n" + bytes(36) + b"\xff\xff\xff\x7f",
    ),
    "accessor without a buffer": (
        ".glb",
        glb(gltf_header(accessors=vertices(10**10))),
    ),
    "negative accessor": (".glb", glb(gltf_header(accessors=vertices(-3)))),
    "buffer in a file": (".glb", glb(gltf_header(buffers=[{"uri": "/etc/passwd", "byteLength": 9}]))),
    "buffer by http": (".glb", glb(gltf_header(buffers=[{"uri": "http://127.0.0.1:9/", "byteLength": 9}]))),
    "nodes that contain themselves": (
        ".glb",
        glb(gltf_header(nodes=[{"children": [1]}, {"children": [0], "mesh": 0}], scenes=[{"nodes": [0]}])),
    ),
    "many instances": (
        ".glb",
        glb(
            gltf_header(
                nodes=[{"mesh": 0}] * 2000,
                scenes=[{"nodes": list(range(2000))}],
                accessors=vertices(9000),
            )
        ),
    ),
    "nested lists": (".glb", glb(b"[" * 1_000_000)),
    "empty .glb": (".glb", b""),
    "random .glb": (".glb", np.random.default_rng(0).bytes(500)),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_broken_or_hostile_mesh_is_refused(case, tmp_path):
    suffix, content = HOSTILE[case]
    with pytest.raises(InvalidInputError, match=f"^mesh 'mesh{suffix}'") as error:
        load_mesh(write(tmp_path, f"mesh{suffix}", content))
    assert "SECRET" not in str(error.value) and "root:" not in str(error.value) and len(str(error.value)) < 200


def test_large_meshes_are_refused(tmp_path, monkeypatch):
    path = write(tmp_path, "box.stl", trimesh.creation.box().export(file_type="stl"))
    monkeypatch.setattr(mesh_loading, "MAX_FACES", 11)
    with pytest.raises(InvalidInputError, match="it has 12 triangles, 1 to 11 are needed"):
        load_mesh(path)
    assert MAX_FACES >= 1_000_000


def test_what_is_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "folder.stl").mkdir()
    (tmp_path / "link.stl").symlink_to(write(tmp_path, "box.stl", trimesh.creation.box().export(file_type="stl")))
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    for name in ("pipe.stl", "folder.stl", "link.stl", "zero.stl", "none.stl", "file.txt"):
        with pytest.raises(InvalidInputError, match=f"mesh '{name}'"):
            load_mesh(tmp_path / name)
