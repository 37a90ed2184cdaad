"""Flat colours of the materials of meshes. All else of a material is left out before a parser sees it."""

from __future__ import annotations

import json
import re
import struct
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.array_types import Array

GLTF_HEADER_BYTES = 12
GLTF_CHUNK_HEADER_BYTES = 8
MAX_MATERIAL_BYTES = 1024 * 1024
"""Size of a .mtl file."""
MATERIAL_LINE = re.compile(rb"^\s*(newmtl\s+\S.*|Kd(\s+[\d.eE+-]+){3}|d\s+[\d.eE+-]+)\s*$")


def with_flat_gltf_materials(content: bytes, header: dict[str, Any]) -> bytes:
    """Return a .glb without images and textures: of its materials the base colours remain.

    Parameters
    ----------
    content : bytes
    header : dict
        Its first chunk.
    """
    kept = {name: value for name, value in header.items() if name not in ("images", "textures", "samplers")}
    kept["materials"] = [_flat_gltf_material(material) for material in header.get("materials", ())]
    text = json.dumps(kept).encode()
    text += b" " * (-len(text) % 4)
    start = GLTF_HEADER_BYTES + GLTF_CHUNK_HEADER_BYTES + int.from_bytes(content[12:16], "little")
    chunks = struct.pack("<I", len(text)) + content[16:20] + text + content[start:]
    return content[:8] + struct.pack("<I", GLTF_HEADER_BYTES + len(chunks)) + chunks


def _flat_gltf_material(material: Any) -> dict[str, Any]:
    """Return a material with its base colour alone."""
    factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
    values = np.clip(np.array(factor, dtype=float).reshape(4), 0.0, 1.0)
    values[:3] = _encode_light(values[:3])
    return {"pbrMetallicRoughness": {"baseColorFactor": values.tolist()}}


def _encode_light(linear: Array) -> Array:
    """Return values of sRGB for amounts of light, 0 to 1: colours of glTF are the latter, all others the former."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


class MaterialFiles:
    """A resolver for the files that an .obj refers to: .mtl files beside it, of which the colours are read.

    Parameters
    ----------
    read : callable
        Returns the content of a file in the folder of the .obj, by its bare name. It raises InvalidInputError.
    """

    def __init__(self, read: Callable[[str], bytes]) -> None:
        self._read = read

    def get(self, name: str) -> bytes:
        """Return the lines of a .mtl file with names and colours. Raises KeyError for all other files."""
        if not re.fullmatch(r"[\w. +-]+\.mtl", name) or name.startswith("."):
            raise KeyError("a mesh may refer to .mtl files beside it alone")
        content = self._read(name)
        if len(content) > MAX_MATERIAL_BYTES:
            raise KeyError(f"a .mtl file has more than {MAX_MATERIAL_BYTES} bytes")
        return b"\n".join(line for line in content.splitlines() if MATERIAL_LINE.match(line))

    __getitem__ = get

    def keys(self) -> tuple[str, ...]:
        """Return no names: files are not listed."""
        return ()

    def namespaced(self, _: str) -> MaterialFiles:
        """Return the same resolver."""
        return self


class NoFiles(MaterialFiles):
    """A resolver that finds no file."""

    def __init__(self) -> None:
        super().__init__(lambda name: b"")

    def get(self, name: str) -> NoReturn:
        """Raise KeyError."""
        raise KeyError("a mesh may not refer to other files")

    __getitem__ = get
