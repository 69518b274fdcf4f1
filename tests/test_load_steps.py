"""Steps of a scene's file: what each word makes of the histories, and what is refused."""

import copy
import warnings

import numpy as np
import pytest
from scene_files import text

from isorod import InputError
from isorod.files.scene import FileScene
from isorod.output import curves

PULLED = {
    "analysis": "statics",
    "rod": {
        "bar": {
            "curve": {"straight": 4.0},
            "section": {"circle": 0.5, "n": 4},
            "law": {"NeoHookean": {"E": 100.0, "nu": 0.3}},
            "density": 0.1,
            "expansion": 1e-4,
            "temperature": 10.0,
            "space": {"elements": 2, "degree": 2, "order": 1},
        }
    },
    "support": {
        "foot": {"end": "start"},
        "head": {"end": "end", "components": "z", "displacement": [0.0, 0.0, 0.02]},
    },
    "load": {"push": {"per_length": [0.01, 0.0, 0.0]}, "side": {"per_length": [0.0, 0.01, 0.0]}},
    "gravity": {"acceleration": [0.0, 0.0, -1.0]},
}
STEPS = [
    {"time": 1.0, "load": {"push": 1.0}, "support": {"head": 0.5}},
    {"time": 2.0, "load": {"push": [2, -1]}, "cycle": 2},
    {"time": 0.5, "hold": True},
    {"time": 1.0, "gravity": 1.5, "temperature": {"bar": 2}},
    {"time": 0.5, "unload": True},
]


@pytest.fixture
def scene(tmp_path):
    def made(**changed):
        table = copy.deepcopy(PULLED) | {"step": STEPS} | changed
        path = tmp_path / "my.toml"
        path.write_text(text({key: one for key, one in table.items() if one is not None}))
        return FileScene(str(path))

    return made


def test_steps_become_histories_and_an_end_time(scene):
    made = scene()
    assert made.settings()["end_time"] == 5.0
    model = made.model()
    push, side, weight = model.loads
    rows = list(zip(push.history.times, push.history.factors, strict=True))
    there_and_back = [(1 + k / 3, value) for k, value in enumerate((1.0, 2.0, -1.0, 1.0, 2.0, -1.0, 1.0))]
    wanted = [(0, 0), *there_and_back, (3.5, 1), (4.5, 1), (5.0, 0)]
    assert rows == [pytest.approx(one) for one in wanted]
    assert side.history is None and model.supports[0].history is None
    assert [weight.history.at(time) for time in (1.0, 3.5, 4.5, 5.0)] == [0.0, 0.0, 1.5, 0.0]
    assert model.supports[1].history.at(4.0) == 0.5 and model.supports[1].history.at(5.0) == 0.0
    (law,) = model.bodies[0].laws[:1]
    assert [law.history.at(time) for time in (3.5, 4.0, 4.5, 5.0)] == [0.0, 1.0, 2.0, 0.0]
    # Modes follow them as statics does, to a time of their own.
    assert scene(analysis={"modal": {"end_time": 2.0}}).settings()["end_time"] == 2.0
    assert scene(step=None).settings().get("end_time") is None


def test_a_run_writes_its_measures_over_time_and_draws_loops(scene, command, tmp_path):
    scene(measure={"force": {"reaction": "head", "component": "z"}, "mid": {"displacement": "bar", "u": 0.5}})
    out = tmp_path / "out"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        record = command.record("run", tmp_path / "my.toml", "--output", out)
    assert record["end_time"] == 5.0 and record["error_estimate"] > 0.0
    found = curves.read(out / "my.csv")
    assert next(iter(found)) == "time" and {1.0, 3.0, 3.5, 4.5, 5.0} <= {*found["time"]}
    held = (found["time"] >= 3.0) & (found["time"] <= 3.5)
    force = next(values for name, values in found.items() if name.startswith("force"))
    assert np.ptp(force[held]) < 1e-9 * np.nanmax(np.abs(force))
    # Side, which no step names, is as the first step left it.
    assert found["support foot force y"][found["time"] >= 1.0] == pytest.approx(-0.04, rel=1e-6)
    loops = [one for panel in curves.panels(found, {}) for one in panel.curves if "displacement" in one[0]]
    assert ("support head displacement z", "support head force z") in loops


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"step": []}, "step: got [], need steps, each a table"),
        ({"step": [{"time": 1.0}]}, "step[0]: it is empty"),
        ({"step": [{"hold": True}]}, "step[0].time: missing"),
        ({"step": [{"time": -1.0, "hold": True}]}, "step[0].time: got -1.0, need how long"),
        ({"step": [{"time": 1.0, "hold": False}]}, "step[0].hold: got false, need true"),
        ({"step": [{"time": 1.0, "hold": True, "unload": True}]}, "step[0]: it has hold and unload"),
        ({"step": [{"time": 1.0, "hold": True, "cycle": 2}]}, "step[0].cycle: need values"),
        ({"step": [{"time": 1.0, "load": {"push": 1.0}, "cycle": 0}]}, "step[0].cycle: got 0"),
        ({"step": [{"time": 1.0, "load": {"push": "up"}}]}, "step[0].load.push: got 'up', need a factor"),
        ({"step": [{"time": 1.0, "load": {"pusch": 1.0}}]}, "step[0].load: 'pusch' is not known; did you mean push"),
        ({"step": [{"time": 1.0, "loads": {"push": 1.0}}]}, "step[0]: 'loads' is not known; did you mean load"),
        ({"step": [{"time": 1.0, "spin": 1.0}]}, "step[0].spin: the file has no [spin]"),
        ({"step": [{"time": 1.0, "support": {"foot": 1.0}}]}, "the support does not move"),
        ({"analysis": "buckling"}, "analysis: steps are of statics, modal, dynamics"),
        ({"analysis": {"statics": {"end_time": 9.0}}}, "it ends at time 5, before end_time 9"),
        (
            {"gravity": {"acceleration": [0.0, 0.0, -1.0], "history": [[0, 0], [5, 1]]}},
            "gravity.history: steps has it too",
        ),
    ],
)
def test_what_no_step_can_be_is_one_line(scene, changed, said):
    with pytest.raises(InputError) as problem:
        made = scene(**changed)
        with made.locating():
            model = made.model()
            from isorod import statics

            statics.solve(model, **made.settings())
    assert said in str(problem.value) and "\n" not in str(problem.value)
    assert "my.toml:" in str(problem.value)
