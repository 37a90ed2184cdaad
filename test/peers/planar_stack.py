"""Two planar 3-RRR in series with invented numbers, as a table: the upper one stands askew on a turntable that the
platform of the lower one carries, and a pointer turns on the upper one. The legs may have springs."""

LEG = """\
  - joints:
{mount}
      - {{joint: crank, link: crank, mass: 1.5*s, centre_of_mass: [s*0.1, 0.01, 0],
         central_inertia: {{xx: 0.003, yy: 0.009, zz: 0.01}},
         rotor_inertia: 0.02, viscous_friction: 0.3, initial_position: toward + pi - bent}}
{gear}
      - {{joint: elbow, link: fore, mdh: {{d: s*0.25}}, role: passive, viscous_friction: 0.02,
         mass: s, centre_of_mass: [s*0.12, 0, 0.02],
         central_inertia: {{xx: 0.001, yy: 0.008, zz: 0.008}}, initial_position: 2*bent}}
    end: {{joint: wrist, moved: {{mdh: {{d: s*0.25}}}}, initial_position: -toward - pi - bent}}
    copies:
"""
COPY = """\
      - suffix: _{platform}_{number}
        base: {{mdh: {{gamma: toward, d: s*0.45, theta: -toward}}}}
        platform: {{antecedent: {platform}, mdh: {{gamma: toward, d: s*0.1, theta: -toward}}}}
        parameters: {{toward: {toward}, s: {size}}}
"""
WHOLE = """\
robot: planar_stack
gravity: [1.0, -4.0, -9.0]
parameters: {{s: 1, toward: 0, bent: acos(0.7)}}
base: {{link: ground}}
joints:
  - {{joint: turn, link: turntable, antecedent: lower, mdh: {{d: 0.03, alpha: 0.3, r: 0.1}}, mass: 0.8,
     centre_of_mass: [0.01, 0.02, 0], central_inertia: {{xx: 0.01, yy: 0.01, zz: 0.02}}, rotor_inertia: 0.01}}
  - {{type: fixed, link: bench, antecedent: turntable, mdh: {{d: 0.02, r: 0.05}}}}
  - {{joint: point, link: pointer, antecedent: upper, mdh: {{alpha: 0.5, d: 0.02}}, mass: 0.2,
     centre_of_mass: [0.05, 0, 0.01], central_inertia: {{xx: 0.001, yy: 0.002, zz: 0.002}}}}
platforms:
  - {{link: upper, base: bench, free: [x, y, yaw], mass: 1, centre_of_mass: [0.01, 0, 0.02],
     limits: {{x: {{lower: -0.02, upper: 0.02}}, y: {{lower: -0.02, upper: 0.02}}, yaw: {{lower: -0.3, upper: 0.3}}}},
     central_inertia: {{xx: 0.006, yy: 0.005, zz: 0.01}}}}
  - {{link: lower, free: [x, y, yaw], mass: 4, centre_of_mass: [0.02, 0.01, 0.03], limits: {{x: {{lower: -0.06,
     upper: 0.06}}, y: {{lower: -0.06, upper: 0.06}}, yaw: {{lower: -0.3, upper: 0.3}}}},
     central_inertia: {{xx: 0.03, yy: 0.04, zz: 0.06}}}}
legs:
"""
GEAR = """\
      - {joint: gear, link: crank_side, role: elastic, spring: {stiffness: 300*s, rest: 0.01, damping: 0.5},
         mass: 0.5*s, centre_of_mass: [0.02, 0, 0], central_inertia: {xx: 0.001, yy: 0.004, zz: 0.004}}"""
MOUNT = """\
      - {joint: mount, link: stator, role: elastic, spring: {stiffness: 500*s, rest: -0.02, damping: 0.4},
         mass: 0.8, centre_of_mass: [0.01, 0, 0], central_inertia: {xx: 0.01, yy: 0.015, zz: 0.02}}"""


def planar_stack(springs=None):
    """Return the text of the description.

    springs: `gears` between the motors and their cranks, or `mounts` that carry the motors.
    """
    leg = LEG.format(mount=MOUNT if springs == "mounts" else "", gear=GEAR if springs == "gears" else "")
    around = ("pi/2", "-5*pi/6", "-pi/6")
    copies = [
        COPY.format(platform=platform, number=number, toward=toward, size=size)
        for platform, size in (("lower", 1), ("upper", 0.4))
        for number, toward in enumerate(around, start=1)
    ]
    return WHOLE.format() + leg + "".join(copies)
