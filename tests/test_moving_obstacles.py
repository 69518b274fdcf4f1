"""Obstacles that move and turn: nothing but a change of frame, rope over drums, and the work they do."""

from pathlib import Path

import numpy as np
import pytest
from conftest import straight
from touching import STIFF, bar

from isorod import (
    Body,
    Contact,
    Cylinder,
    InputError,
    Model,
    Plane,
    Space,
    Sphere,
    Support,
    TriangleMesh,
    dynamics,
    files,
    statics,
)
from isorod.contact.operator import ContactOperator
from isorod.dynamics.explicit.mass import Mass
from isorod.files.scene import FileScene
from isorod.model.moving import ObstacleMotion
from isorod.tensors import rotation

HOW = {"penalty": 1e3, "points": (6, 4), "friction": 0.2}
CENTER = (0.0, -9.0, -1.0)
ANGLE = 0.02
BOX = TriangleMesh(
    np.array([[x, y, z] for x in (-9.0, 9.0) for y in (-5.0, -1.0) for z in (-9.0, 9.0)]),
    [(int(a), int(b), int(c)) for a, b, c in "013 032 467 475 045 051 237 276 026 064 157 173".split()],
)


def shapes(motion=None):
    """A plane, a roller across, a ball and a box beneath a bar of radius 1 along z about the origin."""
    return {
        "plane": Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), motion=motion),
        "cylinder": Cylinder((0.0, -3.0, 0.0), (1.0, 0.0, 0.0), 2.0, motion),
        "sphere": Sphere((0.0, -3.0, 0.0), 2.0, motion),
        "mesh": TriangleMesh(BOX.vertices, BOX.triangles, motion),
    }


def held(obstacle, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    space = bar(4.0)
    supports = [Support.end(space, end, displacement=shift, turn=turn, center=CENTER) for end in ("start", "end")]
    return Model([Body(space, STIFF, density=1.0)], supports, contacts=[Contact(0, obstacle, **HOW)])


@pytest.mark.parametrize("name", ["plane", "cylinder", "sphere", "mesh"])
@pytest.mark.parametrize("turns", [False, True], ids=["moves", "turns"])
def test_a_moving_obstacle_is_a_standing_one_from_which_the_rod_is_moved(name, turns):
    """To solver tolerance, with friction, by steps; the obstacle comes up by 0.03 and goes aside, or turns about x."""
    way = np.array([0.01, 0.03, 0.02])
    motion = ObstacleMotion(angle=ANGLE, axis=(-1.0, 0.0, 1.0), center=CENTER) if turns else ObstacleMotion(move=way)
    about = ANGLE * np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0) if turns else np.zeros(3)
    back = {"turn": tuple(-about)} if turns else {"shift": tuple(-way)}
    moving, standing = (
        statics.solve(model, load_steps=3) for model in (held(shapes(motion)[name]), held(shapes()[name], **back))
    )
    force = standing.contacts[0].force
    assert force > 0.3 and np.linalg.norm(standing.contacts[0].friction) > 0.02 * force
    # Where points begin to stick in a step, its predictor says, and those of both turns differ by the square of that.
    near = 1e-4 if turns else 1e-6
    assert moving.contacts[0].force == pytest.approx(force, rel=near)
    turned = rotation(about)
    for one, other in (
        (moving.contacts[0].friction, standing.contacts[0].friction),
        (moving.reactions[0], standing.reactions[0]),
        (moving.path[-1].obstacles[0, :3], standing.path[-1].obstacles[0, :3]),
    ):
        np.testing.assert_allclose(one, turned @ other, atol=near * force)
    # What holds the bar is what presses on it.
    np.testing.assert_allclose(moving.reactions.sum(axis=0), -moving.path[-1].obstacles[0, :3], atol=1e-6 * force)


def test_a_flat_mesh_rubs_as_a_plane_does():
    motion = ObstacleMotion(move=(0.0, 0.03, 0.05))
    one, other = (statics.solve(held(shapes(motion)[name]), load_steps=2) for name in ("plane", "mesh"))
    assert abs(one.contacts[0].friction[2]) > 0.1 * one.contacts[0].force
    np.testing.assert_allclose(one.reactions, other.reactions, atol=1e-8 * one.contacts[0].force)


def test_forces_change_with_the_way_as_is_said():
    operator = ContactOperator(held(shapes(ObstacleMotion((0.0, 0.1, 0.0), 0.3, "z", CENTER))["cylinder"]))
    displacement = np.tile([0.0, -0.02, 0.0], operator.model.dofs // 3)
    operator.place(0.2)
    operator.accept(displacement)

    def forces(factor):
        operator.place(factor)
        return operator.forces(displacement)[0]

    wanted = (forces(0.3 + 1e-5) - forces(0.3)) / 1e-5
    found = operator.carried_along(displacement, 0.3, 0.1) / 0.1
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


def belt(speed, friction=0.1):
    """A free rod pressed between two rough planes that both go along it, and their time table."""
    motion = ObstacleMotion([[0.0, 0.0, 0.0, 0.0], [50.0, 0.0, 0.0, 50.0 * speed]]) if speed else None
    space = Space.paper(straight(8, breaks=(0.0, 1.0, 2.0), height=2.0), degree=2, order=2, quadrature="auto")
    planes = [Plane((0.0, side * 0.98, 0.0), (0.0, -side, 0.0), motion=motion) for side in (-1.0, 1.0)]
    contacts = [Contact(0, plane, 3e3, points=(4, 3), friction=friction) for plane in planes]
    model = Model([Body(space, STIFF, density=1.0)], [], contacts=contacts)
    return model, (model.is_control_point[:, None] * np.array([0.0, 0.0, 1.0])).ravel()


@pytest.mark.filterwarnings("ignore:time step")
@pytest.mark.parametrize(("integrator", "step", "end"), [("explicit", 1e-3, 1.2), ("implicit", 8e-3, 0.32)])
def test_a_belt_is_a_standing_one_seen_from_a_frame_that_moves(integrator, step, end):
    """Slips, and sticks, the same as seen from the belt; what the belt works is dissipated or kinetic."""
    speed, given = 0.2, {"time_step": step, "outputs": 2, "integrator": integrator}
    standing, along = belt(0.0)
    still = dynamics.solve(standing, end, velocity=-speed * along, **given)
    moving = dynamics.solve(belt(speed)[0], end, **given)
    expected = still.displacement + speed * still.times[:, None] * along
    assert np.abs(moving.displacement - expected).max() < 1e-7
    assert moving.dissipated[-1] == pytest.approx(still.dissipated[-1], rel=1e-6)
    assert moving.dissipated[-1] > 1e-3
    assert np.abs(moving.obstacle_forces[1:, :, 2]).max() > 1e-2
    # The belts go at one speed: their work is their impulse times that, here the momentum of the rod.
    momentum = Mass(standing, np.arange(standing.dofs)).momenta(moving.velocity[-1]) @ along
    assert moving.load_work[-1] == pytest.approx(speed * momentum, rel=1e-9)
    # So what energy is lost or won is what it is on the standing one.
    assert np.abs(moving.energy_error).max() < 0.03
    assert moving.momentum_error.max() < 1e-9


@pytest.mark.filterwarnings("ignore:time step")
def test_a_motion_goes_on_from_a_checkpoint(tmp_path):
    given = {"time_step": 8e-3, "outputs": 4, "integrator": "implicit"}
    whole = dynamics.solve(belt(0.2)[0], 0.32, **given)
    path = tmp_path / "half.npz"
    dynamics.solve(belt(0.2)[0], 0.16, **given | {"outputs": 2}, checkpoint=path)
    rest = dynamics.solve(belt(0.2)[0], 0.32, **given, checkpoint=path, resume=True)
    assert np.array_equal(rest.displacement, whole.displacement) and np.array_equal(rest.load_work, whole.load_work)
    with pytest.raises(InputError, match="checkpoint"):
        dynamics.solve(belt(0.3)[0], 0.32, **given, checkpoint=path, resume=True)


def test_a_roller_that_turns_drives_a_bar_by_what_it_is_turned_with():
    """A turned roller under a held bar slips: its moment is friction times radius, and does all work."""
    roller = Cylinder((0.0, -2.97, 0.0), (1.0, 0.0, 0.0), 2.0, ObstacleMotion(angle=[[0.0, 0.0], [1.0, 2.0]]))
    solution = statics.solve(held(roller), load_steps=4)
    force, moment = np.split(solution.path[-1].obstacles[0], 2)
    (contact,) = solution.contacts
    assert contact.slipping > 0 and contact.sticking == 0
    assert abs(force[2]) == pytest.approx(0.2 * contact.force, rel=0.02)
    assert moment[0] == pytest.approx(2.0 * abs(force[2]), rel=0.02)
    assert len(solution.path) >= 10


MOTIONS = [
    ({}, "move and angle are zero"),
    ({"move": (1.0, 2.0)}, r"move: got shape \(2,\), need"),
    ({"move": [[0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]]}, "need zeros: the obstacle as it stands"),
    ({"angle": [[0.0, 0.0], [1.0, 2.0], [1.0, 3.0]], "axis": "z"}, "row 2 is at 1, need .* that rise"),
    ({"move": (0.0, np.nan, 0.0)}, "finite"),
    ({"angle": 1.0, "axis": (0.0, 0.0, 0.0)}, "need a direction"),
    ({"move": (1.0, 0.0, 0.0), "axis": "z"}, "axis is given, but no angle"),
]


@pytest.mark.parametrize(("given", "said"), MOTIONS)
def test_wrong_motions_are_refused(given, said):
    with pytest.raises(InputError, match=f"motion: .*{said}"):
        ObstacleMotion(**given)


def test_motions_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="motion: axis is missing"):
        shapes(ObstacleMotion(angle=1.0, center=CENTER))
    with pytest.raises(InputError, match="motion: center is missing"):
        TriangleMesh(BOX.vertices, BOX.triangles, ObstacleMotion(angle=1.0, axis="z"))
    with pytest.raises(InputError, match="travel and motion are given"):
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0, ObstacleMotion((1.0, 0.0, 0.0)))
    late = held(shapes(ObstacleMotion([[0.0] * 4, [2.0, 0.0, 0.1, 0.0]]))["plane"])
    with pytest.raises(InputError, match="contact 0: motion of the obstacle: got rows up to 2, need load factors"):
        statics.solve(late)
    plain = held(shapes(ObstacleMotion((0.0, 0.1, 0.0)))["plane"])
    for integrator in ("explicit", "implicit"):
        with pytest.raises(InputError, match="contact 0: motion of the obstacle by load factor is for statics alone"):
            dynamics.solve(plain, end_time=1.0, time_step=0.1, integrator=integrator)


ROLLER = """
[rod.bar]
curve = {straight = {start = [-20.0, 0.0, 0.0], end = [20.0, 0.0, 0.0]}}
section = {circle = 3.0}
law = {NeoHookean = {E = 2.0e5, nu = 0.3}}
space = {elements = 4, degree = 3, order = 2, section_points = 8}
[obstacle.roller]
Cylinder = {point = [0.0, 8.0, 0.0], axis = [0, 0, 1], radius = 5.0}
motion = {move = [[0, 0, 0, 0], [0.5, 0, -0.05, 0], [1, 0.02, -0.05, 0]], angle = [[0, 0], [1, 3]]}
[contact.roller]
first = "bar"
second = "roller"
penalty = 2.0e5
points = [8, 8]
friction = 0.1
[support.left]
end = "start"
[support.right]
end = "end"
[analysis.statics]
load_steps = 2
[measure.press]
obstacle_force = "roller"
[measure.torque]
obstacle_moment = "roller"
component = "z"
[measure.left]
reaction = "left"
[measure.right]
reaction = "right"
"""


def test_a_file_says_how_a_roller_moves(tmp_path):
    path = tmp_path / "roller.toml"
    path.write_text(ROLLER)
    scene = FileScene(str(path))
    solution = statics.solve(scene.model(), **scene.settings())
    assert [step.factor for step in solution.path] == [0.5, 1.0]
    found = scene.measure(solution)
    press, track = found["press"], scene.model().contacts[0].motion.track
    np.testing.assert_allclose(track[-1], (1.0, 0.02, -0.05, 0.0, np.radians(3.0)))
    np.testing.assert_allclose(found["left"] + found["right"], -press, atol=1e-8 * abs(press[1]))
    # The roller slips on the bar: it goes along by 0.02, its surface by 0.26 more.  Normals tilt a little.
    assert press[0] == pytest.approx(0.1 * abs(press[1]), rel=2e-2)
    assert found["torque"] == pytest.approx(5.0 * 0.1 * solution.contacts[0].force, rel=1e-2)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("angle = [[0, 0], [1, 3]]", 'angle = "3 deg"', "angle"),
        ("move = [[0, 0, 0, 0], ", "move = [[0.1, 0, 0, 0], ", "move: got a first row"),
        ("angle =", "turn =", "turn"),
        ('obstacle_force = "roller"', 'obstacle_force = "bar"', "bar.*roller"),
    ],
)
def test_what_a_file_says_wrong_is_refused_in_a_line(tmp_path, old, new, said):
    path = tmp_path / "roller.toml"
    path.write_text(ROLLER.replace(old, new))
    with pytest.raises(InputError, match=f"roller.toml.*{said}") as caught:
        FileScene(str(path)).model()
    assert "\n" not in str(caught.value)


def test_a_drum_hauls_a_rope_as_a_capstan_does(tmp_path):
    """Half a turn: tensions by exp of friction times angle, times the drum's radius over that of the rope's axis."""
    path, example = tmp_path / "drum.toml", Path(files.__file__).parent / "examples" / "contact" / "drum.toml"
    # All of it slips long before the end of the example's 20 degrees.
    path.write_text(example.read_text().replace("[1, 20]", "[1, 3]"))
    scene = FileScene(str(path))
    solution = statics.solve(scene.model(), **scene.settings())
    found = scene.measure(solution)
    assert -found["pull"] == pytest.approx(np.exp(-0.2 * np.pi * 20.0 / 20.25), rel=2e-3)
    assert solution.contacts[0].sticking == 0
