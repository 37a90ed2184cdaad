"""The Stäubli RX90 with random parameters: a SYMORO+ .par, an MDH table in YAML and a model built by hand in Pinocchio
have the same dynamics, rotor inertia and friction included."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from robot_dynamics import Dynamics, load_robot

# α, d, r of the table (W. Khalil and E. Dombre, "Modeling, Identification and Control of Robots"); θ is the variable
GEOMETRY = [("0", "0", "0"), ("pi/2", "0", "0"), ("0", "D3", "0"), ("-pi/2", "0", "RL4"), ("pi/2", "0", "0"),
            ("-pi/2", "0", "0")]  # fmt: skip
KEYS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M", "IA", "FV", "FS")
SYMORO = Path(__file__).parents[2] / "shared" / "data" / "par" / "RX90.par"


def random_parameters(seed):
    """Return a value for each name of the .par: possible bodies, rotors, frictions, lengths, inverted gravity."""
    rng = np.random.default_rng(seed)
    values = {"D3": rng.uniform(0.2, 1), "RL4": rng.uniform(0.2, 1), "G3": -9.81}
    for j in range(1, 7):
        points, masses = rng.uniform(-0.3, 0.3, (6, 3)), rng.uniform(0.1, 3, 6)  # a body of six point masses
        J = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for p, m in zip(points, masses, strict=True))
        moments = [J[0, 0], J[0, 1], J[0, 2], J[1, 1], J[1, 2], J[2, 2]]
        parameters = [*moments, *(masses @ points), masses.sum(), *rng.uniform(0.1, 3, 3)]
        values.update({f"{key}{j}": float(value) for key, value in zip(KEYS, parameters, strict=True)})
    return values


def par_text():
    columns = {"ant": "012345", "sigma": "000000", "b": "000000", "gamma": "000000", "mu": "111111"}
    lists = {key: list(row) for key, row in columns.items()}
    lists |= {"alpha": [g[0] for g in GEOMETRY], "d": [g[1] for g in GEOMETRY], "r": [g[2] for g in GEOMETRY]}
    lists["theta"] = [f"th{j}" for j in range(1, 7)]
    lists |= {key: [f"{key}{j}" for j in range(1, 7)] for key in KEYS}
    lists["QP"] = [f"QP{j}" for j in range(1, 7)]  # state: needs no value
    lists["G"] = ["0", "0", "G3"]
    body = "\n".join(f"{key} = {{{','.join(entries)}}}" for key, entries in lists.items())
    return f"(* Robotname = 'RX90' *)\nNL = 6\nNJ = 6\nNF = 6\nType = 0\n{body}\n(* End of definition *)\n"


def yaml_text(values):
    rows = []
    for j, (alpha, d, r) in enumerate(GEOMETRY, start=1):
        of = {key: values[f"{key}{j}"] for key in KEYS}
        rows.append(
            f"  - joint: joint_{j}\n    link: link_{j}\n    mdh: {{alpha: {alpha}, d: {d}, theta: 0, r: {r}}}\n"
            f"    mass: {of['M']}\n    first_moments: [{of['MX']}, {of['MY']}, {of['MZ']}]\n"
            f"    inertia: {{xx: {of['XX']}, xy: {of['XY']}, xz: {of['XZ']}, yy: {of['YY']}, yz: {of['YZ']}, "
            f"zz: {of['ZZ']}}}\n    rotor_inertia: {of['IA']}\n    viscous_friction: {of['FV']}\n"
            f"    coulomb_friction: {of['FS']}\n"
        )
    parameters = f"{{D3: {values['D3']}, RL4: {values['RL4']}}}"
    return f"robot: RX90\nparameters: {parameters}\nbase: {{link: link_0}}\njoints:\n{''.join(rows)}"


def by_hand(values):
    """Return the chain in Pinocchio: revolute about z, frames placed by Rot(x, α) Trans(x, d) Trans(z, r)."""
    model, parent = pin.Model(), 0
    numbers = {"0": 0.0, "pi/2": np.pi / 2, "-pi/2": -np.pi / 2, "D3": values["D3"], "RL4": values["RL4"]}
    for j, (alpha, d, r) in enumerate(GEOMETRY, start=1):
        c, s = np.cos(numbers[alpha]), np.sin(numbers[alpha])
        R = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        placed = pin.SE3(R, R @ np.array([numbers[d], 0, numbers[r]]))
        parent = model.addJoint(parent, pin.JointModelRZ(), placed, f"joint_{j}")
        xx, xy, xz, yy, yz, zz, mx, my, mz, mass = (values[f"{key}{j}"] for key in KEYS[:10])
        centre = np.array([mx, my, mz]) / mass
        about_centre = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about_centre = about_centre - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        model.appendBodyToJoint(parent, pin.Inertia(mass, centre, about_centre), pin.SE3.Identity())
        model.armature[j - 1] = values[f"IA{j}"]
    return model


def relative_error(actual, expected):
    return np.abs(actual - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize("seed", range(10))
def test_par_and_yaml_agree_with_pinocchio(seed):
    values = random_parameters(seed)
    model = by_hand(values)
    data = model.createData()
    viscous, coulomb = (np.array([values[f"{key}{j}"] for j in range(1, 7)]) for key in ("FV", "FS"))
    descriptions = [(par_text(), values), (yaml_text(values), None)]
    if SYMORO.exists():
        text = SYMORO.read_text()
        descriptions.append((text, values))
    for text, bound in descriptions:
        dynamics = Dynamics(load_robot(text, values=bound))
        assert dynamics.joint_names == tuple(f"joint_{j}" for j in range(1, 7))
        for q, qd, qdd in np.random.default_rng([seed, 1]).uniform(-2, 2, (20, 3, 6)):
            efforts = pin.rnea(model, data, q, qd, qdd) + viscous * qd + coulomb * np.sign(qd)
            assert relative_error(dynamics.inverse(q, qd, qdd), efforts) < 1e-9
            assert relative_error(dynamics.direct(q, qd, efforts), qdd) < 1e-9
            A = np.triu(pin.crba(model, data, q))
            assert relative_error(dynamics.inertia_matrix(q), A + np.triu(A, 1).T) < 1e-9


@pytest.mark.skipif(not SYMORO.exists(), reason="the .par of the SYMORO+ project is not beside this checkout")
def test_par_of_symoro_agrees_with_the_table_of_this_test():
    values = random_parameters(0)
    ours, theirs = (Dynamics(load_robot(text, values=values)) for text in (par_text(), SYMORO.read_text()))
    q = np.linspace(-1, 1, 6)
    np.testing.assert_array_equal(ours.inertia_matrix(q), theirs.inertia_matrix(q))
