"""The loop closed at 1 kHz over real topics, with MuJoCo in a process of its own: how much the model reduces errors."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import peers
import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from robot_dynamics import shipped_robots

PLANT = Path(peers.__file__).with_name("mujoco_plant.py")
FREQUENCY = 2 * np.pi * 3.0  # [rad/s] of the error, critically damped
SECONDS = float(os.environ.get("CLOSED_LOOP_SECONDS", "3"))
# amplitudes of the friction measured by Gaz, Cognetti, Oliva, Robuffo Giordano and De Luca, "Dynamic identification of
# the Franka Emika Panda robot", RA-L 2019, rounded [N m]
COULOMB = [0.55, 0.87, 0.64, 1.28, 0.84, 0.30, 0.56]
VISCOUS = 0.3  # [N m s/rad]


def rubbing_panda(masses=1.0):
    """URDF of the Panda with friction, its masses and moments times a factor."""
    urdf, friction = shipped_robots()["panda"].read_text(), iter(COULOMB)
    urdf = re.sub(r"</joint>", lambda _: f'<dynamics damping="{VISCOUS}" friction="{next(friction)}"/></joint>', urdf,
                  count=len(COULOMB))  # fmt: skip
    scaled = lambda match: f'{match[1]}="{masses * float(match[2])}"'  # noqa: E731
    urdf = re.sub(r'(<mass value)="([^"]+)"', scaled, urdf)
    return re.sub(r'\b(i[xyz]{2})="([^"]+)"', scaled, urdf)


@pytest.fixture(scope="module")
def urdfs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("closed_loop")
    for name, masses in (("panda", 1.0), ("heavy", 1.1)):
        (folder / f"{name}.urdf").write_text(rubbing_panda(masses))
    return folder


def tracked(controller, urdfs):
    """(rms errors of the joints [rad], efforts (N, 7)) of a run of the plant with a controller."""
    result = urdfs / "result.npz"
    command = [sys.executable, PLANT, urdfs / "panda.urdf", result, "--seconds", str(SECONDS)]
    command += ["--controller", controller, "--namespace", controller.rpartition("/")[0]]
    subprocess.run(command, check=True, timeout=60 + 20 * SECONDS)
    run = np.load(result)
    assert run["missed"] == 0, "steps that no efforts came for"
    return np.sqrt((run["error"] ** 2).mean(axis=0)), run["efforts"]


def reactivated(client, controller, changes):
    """The controller with other parameters, as if it had just been started."""
    for transition in (Transition.TRANSITION_DEACTIVATE, None, Transition.TRANSITION_ACTIVATE):
        if transition is None:
            result = client.set_parameters(controller, changes)
            assert result.successful, result.reason
        else:
            request = ChangeState.Request(transition=Transition(id=transition))
            assert client.call(ChangeState, f"{controller}/change_state", request).success


def test_model_makes_errors_ten_times_smaller_than_gains_and_gravity_alone(start_module_server, client, urdfs):
    parameters = {"kp": [FREQUENCY**2], "kd": [2 * FREQUENCY], "use_sim_time": True, "deadline": 5.0}
    parameters["robot_file"] = str(urdfs / "panda.urdf")
    parameters["robot_path"] = [str(urdfs)]
    controller = start_module_server(parameters, executable="computed_torque")
    errors = {}
    print(f"\nrms error of the joints over {SECONDS:g} s at 1 kHz, 3 Hz critically damped [mrad]")
    for name, changes in {
        "full model": {"mode": "computed_torque"},
        "masses +10 %": {"robot_file": str(urdfs / "heavy.urdf")},
        "PD and gravity": {"mode": "pd_gravity", "robot_file": str(urdfs / "panda.urdf")},
        "PD alone": {"gravity": [0.0, 0.0, 0.0]},
    }.items():
        reactivated(client, controller, changes)
        errors[name], efforts = tracked(controller, urdfs)
        assert (np.abs(efforts) <= [87.0] * 4 + [12.0] * 3).all()
        rms = np.sqrt((errors[name] ** 2).mean())
        print(f"{name:<15}{1e3 * rms:8.2f}   by joint {np.array2string(1e3 * errors[name], precision=2)}")
    # of each joint, so that no single one decides
    assert (errors["PD and gravity"] > 10 * errors["full model"]).all()
    assert (errors["PD alone"] > 20 * errors["full model"]).all()
    assert np.linalg.norm(errors["full model"]) < np.linalg.norm(errors["masses +10 %"])
    assert (errors["masses +10 %"] < errors["PD and gravity"]).all()
