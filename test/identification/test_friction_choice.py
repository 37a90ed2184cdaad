"""Choice of friction models by held-out data, for a Panda whose friction is known: efforts of Pinocchio and friction in
closed form."""

import numpy as np
import pytest
from peers.frictional_panda import PLAIN, VARIED, FrictionalPanda
from peers.recorded import JOINTS
from scipy.stats import ttest_rel

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.identification import friction_choice
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.friction_fit import choose_friction_model
from robot_dynamics.identification.friction_terms import PARAMETER_OF_MODEL
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import direct_drives

MODEL = build_identification_model(Dynamics(load_robot("panda")), direct_drives(JOINTS))
TRUE_MODELS = [
    tuple(model for model, parameter in PARAMETER_OF_MODEL.items() if parameter in further) for further in VARIED
]


def choose(recording, models=tuple(PARAMETER_OF_MODEL), *, required=False, method="weighted"):
    """Fit with viscous and Coulomb friction, the model with the chosen friction, and the choice."""
    fit = fit_parameters(Samples([recording], MODEL), method=method)
    model, choice = choose_friction_model(fit, lambda model: Samples([recording], model), models, required=required)
    return fit, model, choice


@pytest.mark.parametrize("seed", range(3))
def test_viscous_and_coulomb_friction_is_kept_where_it_is_all(seed):
    _, model, choice = choose(FrictionalPanda(PLAIN, seed))
    assert choice.terms == () and model.terms == () and model.names == MODEL.names
    assert choice.chosen_rms == pytest.approx(choice.plain_rms)


@pytest.mark.parametrize("method", ["weighted", "robust"])
def test_friction_of_each_joint_is_chosen(method):
    recording = FrictionalPanda(VARIED)
    fit, _, choice = choose(recording, method=method)
    assert [choice.models(joint) for joint in range(7)] == TRUE_MODELS
    assert choice.plain_rms == pytest.approx(fit.held_out_rms, rel=0.02)
    has_more = np.array([bool(models) for models in TRUE_MODELS])
    assert (choice.chosen_rms[has_more] < (1 - friction_choice.MIN_IMPROVEMENT) * choice.plain_rms[has_more]).all()
    assert choice.chosen_rms[~has_more] == pytest.approx(choice.plain_rms[~has_more], rel=0.05)


def test_only_models_that_are_named_are_chosen():
    _, _, choice = choose(FrictionalPanda(VARIED), ("load",))
    assert [choice.models(joint) for joint in (1, 3)] == [("load",), ("load",)]
    assert {term.parameter for term in choice.terms} == {"mu"}


def test_required_models_are_those_of_all_joints():
    _, _, choice = choose(FrictionalPanda(PLAIN, duration=20.0), ("asymmetric", "stribeck"), required=True)
    assert [choice.models(joint) for joint in range(7)] == [("asymmetric", "stribeck")] * 7
    assert len(choice.terms) == 14


def test_friction_that_would_drive_a_joint_is_not_chosen():
    """Dry friction that falls with load, and viscous friction that is negative in one direction, are model errors."""
    driven = [{"mu": -0.2}, {"mu": -0.2}, {"Fva": 4.0}, {"Fva": -4.0}, {}, {}, {}]
    _, _, choice = choose(FrictionalPanda(driven), ("asymmetric", "load"))
    assert choice.terms == ()


def test_a_small_improvement_is_not_chosen(monkeypatch):
    """An asymmetry that is significant, but makes the residuals smaller by less than 5 %."""
    slightly = [{"Fva": 0.17}, {}, {}, {}, {}, {}, {}]
    recording = FrictionalPanda(slightly)
    assert choose(recording, ("asymmetric",))[2].terms == ()
    monkeypatch.setattr(friction_choice, "MIN_IMPROVEMENT", 0.01)
    monkeypatch.setattr(friction_choice, "MIN_SHARE", 0.01)
    assert choose(recording, ("asymmetric",))[2].models(0) == ("asymmetric",)


def test_the_improvement_must_exceed_the_scatter_between_blocks():
    rng = np.random.default_rng(0)
    before = rng.chisquare(10, (30, 200))
    after = before + rng.normal(-0.4, 1.0, before.shape)
    significant = friction_choice.is_significantly_smaller(before, after)
    p_values = ttest_rel(before, after, alternative="greater").pvalue
    assert significant.tolist() == (p_values < 0.025).tolist() and 0.2 < significant.mean() < 0.8
    assert not friction_choice.is_significantly_smaller(before[:1], after[:1] - 100).any()
