"""Groups of bodies, and bodies that touch themselves, at rest and in motion: balances, and runs that go on."""

import numpy as np
import pytest
from conftest import straight
from motions import momenta
from touching import ACROSS, moved

from isorod import Body, Contact, Model, NeoHookean, Space, Support, circle, dynamics, helix, statics
from isorod.output import checkpoint

LAW = NeoHookean(100.0, 0.3)


def coil():
    """One turn and a half of a helix, whose wire has the room of a tenth of its radius between turns."""
    return Space.paper(helix(3.0, 2.1, 1.5).sweep(circle(6)), quadrature="auto")


def test_a_helix_pressed_flat_lies_on_itself():
    space = coil()
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, -1.2))]
    contact = Contact(0, None, 200.0, points=(3, 4))
    free = statics.solve(Model([Body(space, LAW)], supports))
    solution = statics.solve(Model([Body(space, LAW)], supports, contacts=[contact]), load_steps=3)
    (result,) = solution.contacts
    assert result.force > 1.0
    assert 0.0 < result.relative_penetration < 0.05
    # Contact is the body's own: the supports balance each other, and are pressed harder than without.
    np.testing.assert_allclose(solution.reactions.sum(axis=0), 0.0, atol=1e-7 * np.abs(solution.reactions).max())
    assert solution.reactions[0, 2] > 1.05 * free.reactions[0, 2]


def thrown(friction=0.0, speed=2.0):
    """Three crossing rods above each other that nothing holds; the upper and the lower fly at the middle one."""
    rod = straight(6, breaks=(0.0, 1.0, 2.0), height=6.0)
    ways = [(0.0, -2.05, -3.0), (-3.0, 0.0, 0.0), (0.3, 2.05, -2.5)]
    spaces = [Space.paper(moved(rod, way, ACROSS if k == 1 else None), quadrature="auto") for k, way in enumerate(ways)]
    contact = Contact(range(3), None, 300.0, points=(3, 4), friction=friction)
    model = Model([Body(space, LAW, 2.0) for space in spaces], contacts=[contact])
    velocity = np.zeros((model.dofs // 3, 3))
    body = np.searchsorted(model.first_node, np.arange(model.dofs // 3), side="right") - 1
    velocity[:, 1] = speed * np.array([1.0, 0.0, -1.0])[body] * model.is_control_point
    return model, velocity.ravel()


def fly(integrator, friction=0.0, **settings):
    model, velocity = thrown(friction)
    step = {} if integrator == "explicit" else {"time_step": 0.01}
    return dynamics.solve(
        model, 0.3, **step, integrator=integrator, outputs=settings.pop("outputs", 6), velocity=velocity, **settings
    )


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_rods_that_meet_keep_momentum(integrator):
    """And angular momentum; all three are moved by the contact of all with each other."""
    history = fly(integrator)
    model = history.model
    assert history.contact_force.max() > 1.0
    assert np.abs(history.momentum_error).max() < 1e-12
    assert np.abs(history.energy_error).max() < 0.02
    carried = momenta(model, history.velocity)
    scale = np.abs(carried[0]).sum()
    np.testing.assert_allclose(carried.sum(axis=1), np.tile(carried[0].sum(axis=0), (7, 1)), atol=1e-12 * scale)
    x = np.concatenate([body.space.positions for body in model.bodies]) + history.displacement.reshape(7, -1, 3)
    turning, loose = np.cross(x, carried).sum(axis=1), {"implicit": 1e-10, "explicit": 1e-3}[integrator]
    np.testing.assert_allclose(turning, np.tile(turning[0], (7, 1)), atol=loose * scale)
    for first, last in zip(model.first_node, model.first_node[1:], strict=False):
        pushed = carried[-1, first:last].sum(axis=0) - carried[0, first:last].sum(axis=0)
        assert np.abs(pushed).max() > 1e-4 * scale


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_run_of_a_group_goes_on_to_the_last_bit(integrator, tmp_path, monkeypatch):
    """Stopped while three bodies touch and rub."""
    whole, file = fly(integrator, 0.3), tmp_path / "state"
    true, written = checkpoint.write, []

    def write(*arguments):
        true(*arguments)
        written.append(arguments)
        if len(written) == 5:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "write", write)
        with pytest.raises(KeyboardInterrupt):
            fly(integrator, 0.3, checkpoint=file, every=0.0)
    again = fly(integrator, 0.3, checkpoint=file, every=0.0, resume=True)
    assert again.resumed > 0.0
    assert whole.contact_force[4] > 0.0 < whole.dissipated[-1]
    for name in ("times", "displacement", "velocity", "contact_force", "contact_area", "dissipated", "energy_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)


def test_a_coil_that_closes_on_itself_keeps_momentum():
    """A free helix whose ends fly towards each other."""
    space = coil()
    model = Model([Body(space, LAW, 2.0)], contacts=[Contact(0, None, 300.0, points=(3, 4))])
    height = space.positions[:, 2] * space.is_control_point
    velocity = np.zeros((space.nodes, 3))
    velocity[:, 2] = -3.0 * (height - height[space.is_control_point].mean()) * space.is_control_point
    history = dynamics.solve(model, 0.2, outputs=5, velocity=velocity.ravel())
    assert history.contact_force.max() > 1.0
    carried = momenta(model, history.velocity)
    np.testing.assert_allclose(
        carried.sum(axis=1), np.tile(carried[0].sum(axis=0), (6, 1)), atol=1e-12 * np.abs(carried[0]).sum()
    )
    assert np.abs(history.energy_error).max() < 0.02
