"""A 3-RPS with invented numbers, as a table: in each leg the motor and a spring act along the same line. The link
between motor and spring has mass, off the line, and the passive joints have friction."""


def elastic_3rps(stiffness=2e4, damping=0.0):
    """Return the text of the description."""
    return f"""
robot: elastic_3rps
parameters: {{r: 0.4, p: 0.25, height: 0.6, lean: "atan2(height, r - p)", leg: "sqrt((r - p)^2 + height^2)"}}
legs:
  - joints:
      - {{joint: hip, link: tube, role: passive, mdh: {{alpha: pi/2, theta: pi/2}}, initial_position: lean,
         viscous_friction: 0.6, mass: 2, centre_of_mass: [0, -0.1, 0.01],
         central_inertia: {{xx: 0.03, yy: 0.01, zz: 0.03}}}}
      - {{joint: motor, link: screw, type: prismatic, mdh: {{alpha: pi/2}}, initial_position: leg, rotor_inertia: 3,
         viscous_friction: 20, mass: 1.5, centre_of_mass: [0.01, 0.005, -0.2],
         central_inertia: {{xx: 0.02, yy: 0.02, zz: 0.01}}}}
      - {{joint: spring, link: rod, type: prismatic, role: elastic, rotor_inertia: 0.1,
         viscous_friction: {1e-4 * stiffness}, spring: {{stiffness: {stiffness}, rest: 0.001, damping: {damping}}},
         mass: 0.5, centre_of_mass: [0, 0, -0.1], central_inertia: {{xx: 0.004, yy: 0.004, zz: 0.001}}}}
    end: {{joint: ball, type: spherical}}
    copies:
      - {{base: {{mdh: {{d: r, theta: pi}}}}, platform: {{mdh: {{d: p}}}}}}
      - {{base: {{mdh: {{gamma: 2*pi/3, d: r, theta: pi}}}}, platform: {{mdh: {{gamma: 2*pi/3, d: p}}}}}}
      - {{base: {{mdh: {{gamma: -2*pi/3, d: r, theta: pi}}}}, platform: {{mdh: {{gamma: -2*pi/3, d: p}}}}}}
platform:
  link: platform
  mass: 10
  central_inertia: {{xx: 0.3, yy: 0.3, zz: 0.5}}
  initial: {{xyz: [0, 0, height]}}
  free: [z, pitch, roll]
"""
