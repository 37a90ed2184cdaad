"""The shipped free-flying arm, also as a model of Pinocchio."""

from xml.etree import ElementTree

import numpy as np

from peers.pinocchio_model import PinocchioModel
from robot_dynamics import load_robot, shipped_robots
from robot_dynamics.simulation import Simulation

TWIST = np.array([0.02, -0.05, 0.03, 0.04, 0.02, -0.06])
VELOCITIES = np.array([0.5, -0.3, 0.4, 0.2, -0.5, 0.6])


def peer_of(name, joints, gravity=None, moving_base=False):
    tree = ElementTree.parse(shipped_robots()[name])
    for joint in tree.getroot().findall("joint[@type='floating']"):  # the peer adds its own
        tree.getroot().remove(joint)
        tree.getroot().remove(tree.find(f"link[@name='{joint.find('parent').get('link')}']"))
    peer = PinocchioModel(ElementTree.tostring(tree.getroot(), encoding="unicode"), joints, moving_base)
    if gravity is not None:
        peer.model.gravity.linear = np.asarray(gravity)
    return peer


def flying(gravity=(0.0, 0.0, 0.0), **settings):
    simulation = Simulation(load_robot("free_flying_arm", gravity=list(gravity)), **settings)
    return simulation, peer_of("free_flying_arm", simulation.joint_names, gravity, moving_base=True)
