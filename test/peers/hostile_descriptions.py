"""Short descriptions that take long to load unless work is bounded, and a stack of real platforms that is large."""


def legs(count, joints=3, end="spherical"):
    """A platform on `count` legs whose loops do not close."""
    rows = "".join(
        f"      - {{joint: j{k}, link: l{k}, mdh: {{d: 0.{k + 1}, alpha: 0.{k + 3}}}, mass: 1, "
        f"role: {'passive' if k else 'actuated'}}}\n"
        for k in range(joints)
    )
    copies = "".join(f"      - {{base: {{xyz: [{k % 7}, {k // 7}, 0]}}}}\n" for k in range(count))
    return (
        f"robot: r\nlegs:\n  - joints:\n{rows}    end: {{joint: e, type: {end}}}\n    copies:\n{copies}"
        "platform: {link: p, mass: 1}\n"
    )


def leg_copies(row, rows, copies, ends="end: {joint: e, type: spherical}"):
    """A leg of `rows` rows with a number in their names, {k}, and copies of it."""
    text = "".join(f"    - {row.replace('{k}', str(k))}\n" for k in range(rows))
    placed = "".join(f"    - {{suffix: _{k}}}\n" for k in range(copies))
    materials = "materials: {s: {youngs_modulus: 1, poissons_ratio: 0.3, density: 1}}\n"
    sections = "sections: {b: {rectangle: {y: 1, z: 1}}}\n"
    return (
        f"robot: r\n{materials}{sections}legs:\n  - joints:\n    - {{joint: first, link: first}}\n{text}"
        f"    {ends}\n    copies:\n{placed}platform: {{link: p, mass: 1}}\n"
    )


def chain(count, role="actuated"):
    """A chain of revolute joints."""
    rows = "".join(f"- {{joint: j{k}, link: l{k}, mdh: {{d: 1}}, mass: 1, role: {role}}}\n" for k in range(count))
    return f"robot: r\njoints:\n{rows}"


def chain_with_loops(joints, loops):
    """A chain whose links are fixed to points that it cannot reach together."""
    text = "".join(
        f"- {{joint: c{k}, type: spherical, moved: {{antecedent: l{joints - 1 - k % joints}}}, "
        f"closed_on: {{antecedent: base_link, xyz: [{k}, 0.5, 0]}}}}\n"
        for k in range(loops)
    )
    return f"{chain(joints, 'passive')}loops:\n{text}"


def beams(count):
    """A link with beams in a row."""
    text = "".join(f"  - {{from: [{k}, 0, 0], to: [{k + 1}, 0, 0], section: b, material: s}}\n" for k in range(count))
    return (
        "robot: r\nmaterials: {s: {youngs_modulus: 1, poissons_ratio: 0.3, density: 1}}\n"
        f"sections: {{b: {{rectangle: {{y: 1, z: 1}}}}}}\njoints:\n- joint: j\n  link: l\n  beams:\n{text}"
    )


def frames(count):
    """A joint with many frames."""
    return chain(1) + "frames:\n" + "".join(f"- {{frame: f{k}, link: l0, xyz: [0.1, 0, 0]}}\n" for k in range(count))


def fixed_rows(count):
    """Rows without joints."""
    return "robot: r\njoints:\n" + "".join(f"- {{link: l{k}, type: fixed, mass: 1}}\n" for k in range(count))


def platforms(count):
    """Platforms on each other, described from top to bottom."""
    text = "".join(
        f"- {{link: p{k}, base: {f'p{k + 1}' if k < count - 1 else 'base_link'}, mass: 1}}\n" for k in range(count)
    )
    return f"robot: r\njoints: []\nplatforms:\n{text}"


def urdf(count):
    """A chain of links."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = "".join(f'<link name="l{k}">{inertial}</link>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
        for k in range(count)
    )
    return f'<robot name="r">{links}{joints}</robot>'


def par(count):
    """A chain as a SYMORO+ .par."""
    zeros = ",".join(["0"] * count)
    lists = {key: zeros for key in ("sigma", "b", "r", "gamma", "alpha")}
    lists["ant"] = ",".join(map(str, range(count)))
    lists["theta"] = ",".join(f"th{k}" for k in range(count))
    lists["d"] = lists["M"] = lists["mu"] = ",".join(["1"] * count)
    text = "".join(f"{key} = {{{entries}}}\n" for key, entries in lists.items())
    return f"NL = {count}\nNJ = {count}\nNF = {count}\n{text}"


def parameters(count, copies):
    """Parameters that refer to each other, and legs each of which changes the first one."""
    names = "".join(f"  p{k}: {f'p{k - 1} + 1' if k else 1}\n" for k in range(count))
    legs_of_parameters = "".join(f"    - {{parameters: {{p0: {k}}}}}\n" for k in range(copies))
    return (
        f"robot: r\nparameters:\n{names}legs:\n  - joints: [{{joint: j, link: l, mass: 1}}]\n"
        f"    end: {{joint: e, type: spherical}}\n    copies:\n{legs_of_parameters}platform: {{link: p, mass: 1}}\n"
    )


def stacked_platforms(count):
    """Gough-Stewart platforms on each other, with six legs (universal, prismatic, spherical) each."""
    platforms_text = "".join(
        f"- {{link: p{k}, mass: 10, central_inertia: {{xx: 1, yy: 1, zz: 2}}, initial: {{xyz: [0, 0, 1]}}"
        f"{f', base: p{k - 1}' if k else ''}}}\n"
        for k in range(count)
    )
    copies = ""
    for platform in range(count):
        for leg in range(6):
            angle = f"pi/3*{leg}"
            upper = f"{angle} + {(-1) ** leg}*0.2"
            base = f"{{xyz: [cos({angle}), sin({angle}), 0], rpy: [0, 0, {angle}]}}"
            ball = f"{{antecedent: p{platform}, xyz: [0.7*cos({upper}), 0.7*sin({upper}), 0]}}"
            copies += f"  - {{suffix: _{platform}_{leg}, base: {base}, platform: {ball}}}\n"
    return f"""\
robot: stack
legs:
- joints:
  - {{joint: hip, link: cross, role: passive, mdh: {{alpha: pi/2}}, initial_position: pi/2}}
  - {{joint: swing, link: tube, role: passive, mdh: {{alpha: -pi/2, theta: pi/2}}, mass: 1}}
  - {{joint: leg, link: rod, type: prismatic, mdh: {{alpha: pi/2}}, initial_position: 1, mass: 1}}
  end: {{joint: ball, type: spherical}}
  copies:
{copies}platforms:
{platforms_text}"""
