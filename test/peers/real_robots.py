"""URDFs of real robots, from the wheel example-robot-data."""

import re
from pathlib import Path

import pinocchio

# the wheel puts its data beside Pinocchio's, in one prefix
ROBOTS = next(
    folder / "share" / "example-robot-data" / "robots"
    for folder in Path(pinocchio.__file__).parents
    if (folder / "share" / "example-robot-data").is_dir()
)

REAL_ROBOTS = {
    # serial arms
    "panda": "panda_description/urdf/panda.urdf",  # its fingers mimic each other
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    # a hand
    "allegro": "allegro_hand_description/urdf/allegro_right_hand.urdf",
    # mobile and two-armed manipulators
    "tiago": "tiago_description/robots/tiago.urdf",
    "tiago_pro": "tiago_pro_description/robots/tiago_pro.urdf",  # mimic joints
    "baxter": "baxter_description/urdf/baxter.urdf",  # mimic joints
    "pr2": "pr2_description/urdf/pr2.urdf",  # mimic joints
    "b1_z1": "b1_description/urdf/b1-z1.urdf",
    # humanoids
    "talos": "talos_data/robots/talos_full_v2.urdf",  # mimic joints
    "talos_reduced": "talos_data/robots/talos_reduced.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "g1": "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
    # quadrupeds
    "anymal_c": "anymal_c_simple_description/urdf/anymal.urdf",
    "solo12": "solo_description/robots/solo12.urdf",
    "go2": "go2_description/urdf/go2.urdf",
    "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
    # a flying arm and a free rigid body
    "borinot": "borinot_description/urdf/borinot_flying_arm_2.urdf",
    "hector": "hector_description/robots/quadrotor_base.urdf",
}


def real_urdf(name):
    return (ROBOTS / REAL_ROBOTS[name]).read_text()


def without_inertials(urdf):
    """The text of a URDF without its <inertial> elements, as many industrial robots are published."""
    return re.sub(r"<inertial>.*?</inertial>", "", urdf, flags=re.DOTALL)
