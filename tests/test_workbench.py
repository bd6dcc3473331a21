"""The workbench: the page is of its sources, computes what Python does, and does what it says."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import Machine, Scenario, Step
from ambkit.cli.main import main
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.export.browser import axis_parameters, workbench_of
from ambkit.export.browser.page import PAGE
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Loop, simulate_run
from ambkit.simulation.scenario import settled_scenario

ROOT = Path(__file__).parents[1]
WEB = ROOT / "web"
FILTERS = ("linear", "closed-law", "extended", "unscented", "ud", "low-pass", "adaptive")
STARTS = ("levitated", "landed", "released")


def meta(name):
    return re.search(rf'<meta name="{name}" content="([^"]*)"', PAGE.read_text("utf-8"))[1]


def test_the_page_is_of_its_sources():
    single = ["package.json", "package-lock.json", "tsconfig.json", "bundle.mjs", "build.sh"]
    folders = [WEB / name for name in ("core", "src", "vendor")]
    paths = [p for folder in folders for p in folder.rglob("*") if p.is_file()]
    names = sorted([*(p.relative_to(WEB).as_posix() for p in paths), *single])
    total = hashlib.sha256()
    for name in names:
        total.update(f"{name}\0".encode() + (WEB / name).read_bytes() + b"\0")
    assert meta("workbench-sources") == total.hexdigest(), "build it anew: web/build.sh"


def test_the_page_is_small_and_loads_nothing():
    page = PAGE.read_text("utf-8")
    assert len(page.encode()) < 1_000_000
    assert not re.search(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(?!data:)', page)
    assert not re.search(r"\b(?:fetch|XMLHttpRequest|importScripts|WebSocket)\(", page)


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])["machines"]


def test_the_command_writes_the_page_with_the_machine(tmp_path, capsys):
    page = tmp_path / "bench.html"
    with pytest.raises(SystemExit, match="0"):
        main(["workbench", "inteco_ml", "--out", str(page)])
    first, *others = data_of(page.read_text("utf-8"))
    assert first["name"] == "inteco_ml"
    assert [other["name"] for other in others] == ["zittau_axial", "hindawi_2011", "heart_pump"]
    assert first["axis"] == axis_parameters(Machine.preset("inteco_ml"))
    assert "inteco_ml" in capsys.readouterr().out


def test_a_hostile_name_stays_a_name(tmp_path):
    evil = '</script><script>document.title="gone"</script><!--\\u2028'
    machine = Machine.preset("zittau_axial").replace(description=evil)
    page = workbench_of(machine).text
    assert "<script>document" not in page
    assert data_of(page)[0]["description"] == evil
    assert 'srcdoc="' in workbench_of(machine)._repr_html_()
    assert "<script" not in workbench_of(machine)._repr_html_()


def test_machines_that_the_page_cannot_show_are_refused():
    machine = Machine.preset("tum_mlps_flexible")
    machine = machine.replace(delay=2 * machine.sampling_time)
    with pytest.raises(ambkit.AmbkitError, match=r"up to 48 states of the filter; tum_\w+ has 52"):
        _ = workbench_of(machine).text


def test_what_the_page_leaves_out_is_named():
    machine = Machine.preset("zittau_axial").replace(sensor__cubic=1e4)
    assert "without sensor.cubic" in data_of(workbench_of(machine).text)[0]["description"]
    rotor = Machine.preset("hindawi_2011")
    assert "without" not in data_of(workbench_of(rotor).text)[0]["description"]
    sensors = tuple(sensor.model_copy(update={"cubic": 1e4}) for sensor in rotor.sensors)
    rotor = rotor.model_copy(update={"sensors": sensors})
    assert data_of(workbench_of(rotor).text)[0]["description"].endswith("(without sensor.cubic)")


# ---- Numbers ----

CASES = [
    # machine, filters, feedback, start, assumed k over k, Q
    ("zittau_axial", "linear closed-law extended unscented", "measurement", "levitated", 1.0, None),
    ("zittau_axial", "extended ud linear low-pass", "estimate", "levitated", 0.8, 500.0),
    ("zittau_axial", "adaptive closed-law", "estimate", "levitated", 1.0, None),
    ("late", "closed-law extended linear ud", "measurement", "levitated", 1.2, None),
    ("two late", "extended linear unscented low-pass", "estimate", "levitated", 1.0, None),
    ("slow", "linear adaptive extended", "estimate", "levitated", 1.0, None),
    ("inteco_ml", "extended closed-law linear", "estimate", "levitated", 1.0, None),
    ("zittau_axial", "linear unscented", "estimate", "released", 1.0, None),
    ("inteco_ml", "extended", "measurement", "landed", 1.0, None),
]


LATE = {
    "late": {"delay": "0.13 ms", "amplifier__bandwidth": "900 Hz", "sensor__quantisation": "2 um"},
    "two late": {"delay": "0.2 ms"},
    "slow": {"amplifier__bandwidth": "700 Hz"},
}  #: Machines whose filters have states for currents.


def machine_called(name):
    return Machine.preset("zittau_axial" if name in LATE else name).replace(**LATE.get(name, {}))


def simulated(case):
    """Return what Python has of a flight, and what the page is asked for the same."""
    name, kinds, feedback, start, wrong, Q = case
    machine, kinds = machine_called(name), kinds.split()
    scenario = Scenario(
        duration=2000 * machine.sampling_time,
        reference=Step(amplitude=0.1 * machine.clearance, time=300 * machine.sampling_time),
        disturbance=Step(amplitude=0.3 * machine.weight, time=1000 * machine.sampling_time),
        seed=7, start=start,
    ).fed(feedback)  # fmt: skip
    scenario = settled_scenario(machine, scenario)
    known = machine.replace(magnet__magnet_constant=wrong * machine.magnet.magnet_constant)
    noise = FilterNoise(disturbance=Q)
    filters = [KINDS[k].make(known, learned_magnet(k, machine), noise=noise) for k in kinds]
    run = simulate_run(machine, scenario, estimator=filters[0])
    estimates = [run.estimate, *(kf.run(run.record) for kf in filters[1:])]
    asked = axis_parameters(machine, scenario.controller) | {
        "filter_k": wrong, "filter_Q": Q or 0.0, "seed": 7.0, "noisy": 1.0,
        "start": float(STARTS.index(start)),
    }  # fmt: skip
    series = {key: run.record[key].tolist() for key in ("r", "f_d")}
    asked = {"p": asked, **series, "kinds": [FILTERS.index(kind) for kind in kinds]}
    return run.record, dict(zip(kinds, estimates, strict=True)), asked


def same_numbers(record, estimates, told):
    for key in ("x", "v", "y", "u", "iu"):
        assert np.array_equal(told[key], record[key]), key
    for (kind, estimate), of in zip(estimates.items(), told["filters"], strict=True):
        mean = np.reshape(of["mean"], estimate.mean.shape)
        if kind == "low-pass":  # its coefficients are by libm in Python
            np.testing.assert_allclose(mean, estimate.mean, rtol=1e-9, atol=1e-12)
            continue
        assert np.array_equal(mean, estimate.mean), kind
        assert np.array_equal(of["innovation"], estimate.innovation), kind
        assert np.array_equal(of["variance"], estimate.innovation_variance), kind


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    playwright = pytest.importorskip("playwright.sync_api")
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if not program:
        pytest.skip("no chromium here to open the page with")
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def page(browser, tmp_path):
    """The page without a network; whatever it complains of, or asks for, is an error."""
    context = browser.new_context(offline=True, viewport={"width": 1400, "height": 1000})
    opened, complaints = context.new_page(), []
    opened.on("console", lambda message: complaints.append(message.text))
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on(
        "request", lambda asked: complaints.append(asked.url) if asked.url[:4] == "http" else 0
    )
    workbench_of(None).save(tmp_path / "bench.html")
    opened.goto((tmp_path / "bench.html").as_uri())
    opened.wait_for_selector("html[data-ready]")
    opened.add_script_tag(path=Path(__file__).with_name("workbench.js"))
    yield opened
    assert complaints == []
    context.close()


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}-{case[3]}-{case[2]}")
def test_numbers_in_chromium_are_those_of_python(page, case):
    record, estimates, asked = simulated(case)
    same_numbers(record, estimates, page.evaluate("ask.fly", asked))


@pytest.mark.long
@pytest.mark.parametrize("case", [*CASES[:2], CASES[3]], ids=lambda case: f"{case[0]}-{case[2]}")
def test_numbers_in_node_are_those_of_python(case, tmp_path):
    node = shutil.which("node")
    if not node:
        pytest.skip("no node here")
    record, estimates, asked = simulated(case)
    workbench_of(None).save(tmp_path / "bench.html")
    script = Path(__file__).with_name("workbench_node.js")
    command = [node, str(script), str(tmp_path / "bench.html")]
    run = subprocess.run(command, input=json.dumps(asked).encode(), capture_output=True, check=True)
    same_numbers(record, estimates, json.loads(run.stdout))


ROTORS = [
    ("heart_pump", {"runUp": True}),
    ("hindawi_2011", {"feedback": 1, "filters": "linear,extended,unscented,ud"}),
    ("compressor", {}),
    ("ufu_flexible", {"feedback": 1}),
]


@pytest.mark.parametrize(
    ("name", "settings"),
    quick([*ROTORS, ("hindawi_2011", {}), ("tum_mlps", {}), ("ufu_rig", {"seed": 9})], [], ROTORS),
)
def test_a_rotor_flies_as_in_python(page, tmp_path, name, settings):
    machine = Machine.preset(name)
    workbench_of(machine).save(tmp_path / "rotor.html")
    page.goto((tmp_path / "rotor.html").as_uri())
    page.wait_for_selector("html[data-ready]")
    page.add_script_tag(path=Path(__file__).with_name("workbench.js"))
    told = page.evaluate("ask.rotor", [name, settings])
    first = machine.axes[0].name
    n, T = len(told["q"][0]), machine.sampling_time
    feedback = "estimate" if settings.get("feedback") else "measurement"
    force = told["load"][-len(machine.axes)]
    speed = told["speed"]
    scenario = Scenario(
        duration=(n - 1) * T, seed=settings.get("seed", 1),
        controller={"type": "decentralised", "feedback": feedback},
    )  # fmt: skip
    external = ExternalInputs(disturbance=np.reshape(told["load"], (n, -1)))
    kinds = settings.get("filters", "extended,linear").split(",")
    kf, *others = (KINDS[kind].make(machine) for kind in kinds)
    loop = Loop(machine, scenario, estimator=kf, external_inputs=external)
    loop._speed = np.array(speed)  # of the page's own samples, whatever a waveform would round to
    run = loop.run()
    record = run.record
    if not settings.get("runUp"):  # the page's filters have one speed
        estimates = [run.estimate, *(other.run(record) for other in others)]
        for kind, mean, estimate in zip(kinds, told["mean"], estimates, strict=True):
            assert np.array_equal(np.reshape(mean, (n, len(kf.states))), estimate.mean), kind
    for k, position in enumerate(machine.positions):
        assert np.array_equal(told["q"][k], record[f"q_{position}"]), position
    iu = np.reshape(told["iu"], (n, -1))
    for k, axis in enumerate(machine.axes):
        assert np.array_equal(iu[:, k], record[f"iu_{axis.name}"]), axis.name
    assert force != 0
    assert record[f"f_d_{first}"][-1] == force


@pytest.mark.long
def test_each_knob_of_a_rotor_moves_it(page):
    for key, of in page.evaluate("ask.rotorKnobs()").items():
        moves = key not in ("assumed", "R", "Q")
        assert of == {"moves": moves, "filter": True, "finite": True, "back": True}, key
    page.evaluate("workbench.rotor.turn('speed', 3000)")
    link, before = page.url, page.evaluate("JSON.stringify(workbench.rotor.settings)")
    page.goto("about:blank")
    page.goto(link)
    page.wait_for_selector("html[data-ready]")
    assert page.evaluate("JSON.stringify(workbench.rotor.settings)") == before


@pytest.mark.long
@pytest.mark.parametrize("name", ["zittau_axial", "inteco_ml"])
def test_the_sensitivity_is_that_of_the_margins(page, name):
    from ambkit.control.linear.linear_plant import OperatingPoint, plant
    from ambkit.control.linear.steady_state_filter import estimator_at
    from ambkit.control.stabilising_controller import _peaks, chosen

    machine = Machine.preset(name)
    at, gains = OperatingPoint.equilibrium(machine), chosen(machine)
    system = plant(machine, at)
    system = system.select(["y", "x"], system.inputs[0][:1])
    E = estimator_at(KINDS["linear"].make(machine), at)
    for fed in (0, 1):
        told = page.evaluate("ask.margin", [name, fed])
        f = np.array(told["f"])
        P = system.response(f)[:, 0, 0]
        (peak,) = _peaks(machine, [gains], f, P, E.response(f) if fed else None)
        assert told["stable"]
        assert told["peak"] == pytest.approx(float(peak), rel=2e-4)  # of the plant's substeps


@pytest.mark.long
@pytest.mark.parametrize("name", ["tum_mlps", "heart_pump"])
def test_the_sensitivity_of_a_rotor_is_that_of_the_assessment(page, tmp_path, name):
    machine = Machine.preset(name)
    workbench_of(machine).save(tmp_path / "rotor.html")
    page.goto((tmp_path / "rotor.html").as_uri())
    page.wait_for_function("/zone [ABCD]|unstable/.test(document.body.innerText)")
    found = re.search(r"peak ([0-9.]+) at", page.inner_text("body"))
    assessment = ambkit.assess(machine, "none")
    (axis, *_) = assessment.loops[assessment.last].axes.values()
    assert found
    assert float(found[1]) == pytest.approx(axis.peak, rel=1e-2)


# ---- Knobs, links, files ----

SETTINGS = "JSON.stringify(workbench.settings)"


def turn(page, key, value):
    page.evaluate("([key, value]) => workbench.turn(key, value)", [key, value])


def turn_to(page, key, share):
    """Turn a knob to a share of its range."""
    turn(page, key, page.evaluate("([key, share]) => workbench.at(key, share)", [key, share]))


ASSUMED = ("filter_k", "R", "Q")  #: Knobs that move filters and not the flight.


@pytest.mark.long
def test_each_knob_moves_what_it_should(page):
    moved = page.evaluate("ask.knobs()")
    assert len(moved) > 15
    for key, of in moved.items():
        assert of == {
            "flight": key not in ASSUMED,
            "filters": True,
            "finite": True,
            "back": True,
        }, key


@pytest.mark.long
def test_a_link_and_a_file_restore_what_is_set(page, tmp_path):
    for key, value in {"kp": 2500, "delay": 2e-4, "Q": 0.1, "reference": 2e-5}.items():
        turn(page, key, value)
    page.select_option("#choice-start", "released")
    page.click("[aria-label^='Remove Low-pass']")
    before = page.evaluate(SETTINGS)
    link = page.url
    assert "p.kp=2500" in link
    with page.expect_download() as saved:
        page.click("#save summary")
        page.click("#save-toml")
    saved.value.save_as(tmp_path / "kept.toml")
    machine = ambkit.load(tmp_path / "kept.toml")
    assert machine.delay == 2e-4
    assert machine.rotor.mass == Machine.preset("zittau_axial").rotor.mass
    turn(page, "kp", 3000)
    page.set_input_files("#open", tmp_path / "kept.toml")
    page.wait_for_function("workbench.settings.p.kp === 2500")
    assert page.evaluate(SETTINGS) == before
    page.goto("about:blank")
    page.goto(link)
    page.wait_for_selector("html[data-ready]")
    assert page.evaluate(SETTINGS) == before


@pytest.mark.long
def test_files_are_taken_and_refused(page, tmp_path):
    from ambkit.machine import presets

    text = presets.text("inteco_ml").replace('"inteco_ml"', '"<b onclick=alert(1)>mine</b>"')
    (tmp_path / "mine.toml").write_text(text)
    page.set_input_files("#open", tmp_path / "mine.toml")
    page.wait_for_function("() => workbench.settings.machine.name.includes('mine')")
    told = page.evaluate("workbench.settings.p")
    own = axis_parameters(Machine.preset("inteco_ml"))
    gains = ("kp", "ki", "kd", "T_f", "T_t", "weight", "feedback")
    assert {k: v for k, v in told.items() if k not in gains} == pytest.approx(
        {k: v for k, v in own.items() if k not in gains}, rel=1e-12
    )
    assert page.locator("b[onclick]").count() == 0
    assert page.evaluate("() => workbench.panels.margin.peak") < 3
    (tmp_path / "bad.toml").write_text(
        text.replace('mass = "60.54 g"', 'mass = "60.54 lightyears"')
    )
    page.set_input_files("#open", tmp_path / "bad.toml")
    page.wait_for_selector("#status.wrong")
    assert re.match("bad.toml: rotor.mass", page.inner_text("#status"))


@pytest.mark.long
def test_a_record_of_python_is_filtered_to_the_same_bits(page, tmp_path):
    machine = Machine.preset("zittau_axial")
    record = ambkit.simulate(machine, Scenario(duration=0.1, seed=4)).record
    record.save(tmp_path / "run.csv")
    page.evaluate("workbench.settings.kinds = [2, 0], workbench.changed(true)")
    page.set_input_files("#open", tmp_path / "run.csv")
    page.wait_for_function(f"() => workbench.flight.n === {len(record.t)}")
    mean = page.evaluate("() => Array.from(workbench.flight.filters[0].mean)")
    estimate = KINDS["extended"].make(machine).run(ambkit.read(tmp_path / "run.csv").record)
    np.testing.assert_array_equal(np.reshape(mean, estimate.mean.shape), estimate.mean)


@pytest.mark.long
def test_lessons_and_the_challenge(page):
    page.click("#lessons")

    def done():
        page.wait_for_selector("#guide .done:not([hidden])", timeout=15_000)
        page.click("#guide .row button")

    page.click("#power")  # it falls
    done()
    turn_to(page, "kd", 0.02)
    done()
    turn(page, "noise_y", 10 * Machine.preset("zittau_axial").sensor.noise_variance ** 0.5)
    page.select_option("#choice-feedback", "1")
    done()
    turn_to(page, "Q", 0.02)
    done()
    turn_to(page, "filter_k", 0.95)
    done()
    assert page.locator("#guide").is_hidden()
    page.click("#challenge")
    scores = [score(page)]
    turn_to(page, "reference", 0.75)  # nearer to the pole
    scores.append(score(page))
    turn_to(page, "mass", 0.3)
    assert scores[1] > scores[0] > 0
    assert score(page) == 0


def score(page):
    page.evaluate("workbench.compute()")
    return int(page.inner_text("#guide .score"))


@pytest.mark.long
def test_the_rotor_falls_is_knocked_and_is_drawn(page, tmp_path):
    page.keyboard.press("m")
    page.wait_for_function(
        "() => Math.abs(workbench.motion.now.x) > 0.9 * workbench.settings.p.clearance",
        timeout=20_000,
    )
    page.keyboard.press("m")
    page.keyboard.press("r")
    still = page.evaluate("() => Math.abs(workbench.motion.now.x)")
    page.keyboard.press("ArrowUp")
    page.wait_for_function(
        f"() => workbench.motion.now.x > {still} + 0.03 * workbench.settings.p.clearance"
    )
    for what in ("png", "svg", "csv"):
        with page.expect_download() as saved:
            page.click("#save summary")
            page.click(f"#save-{what}")
        saved.value.save_as(tmp_path / f"kept.{what}")
    assert (tmp_path / "kept.png").read_bytes()[:4] == b"\x89PNG"
    assert "<polyline" in (tmp_path / "kept.svg").read_text()
    assert len(ambkit.read(tmp_path / "kept.csv").record.t) == page.evaluate(
        "() => workbench.flight.n"
    )


@pytest.mark.long
def test_a_notebook_shows_it_in_a_frame(page):
    page.goto("about:blank")
    page.set_content(workbench_of(None)._repr_html_())
    frame = page.frame_locator("iframe")
    frame.locator("html[data-ready]").wait_for(state="attached")
    frame.locator("#status:has-text('samples')").wait_for()


WIDGET = """async ([script, page]) => {
  const { default: of } = await import("data:text/javascript," + encodeURIComponent(script));
  const set = { page, settings: "" }, asked = {};
  window.model = {
    get: (name) => set[name], set: (name, value) => (set[name] = value), save_changes() {},
    on: (name, heard) => (asked[name] = heard), off() {},
    change: (value) => ((set.settings = value), asked["change:settings"]()),
  };
  of.render({ model: window.model, el: document.body });
}"""  #: What anywidget does with the script of a widget.


@pytest.mark.long
def test_a_widget_tells_python_what_is_set_and_takes_it(page):
    pytest.importorskip("anywidget")
    widget = workbench_of(None).widget
    assert "application/vnd.jupyter.widget-view+json" in workbench_of(None)._repr_mimebundle_()[0]
    page.goto("about:blank")
    page.evaluate(WIDGET, [widget._esm, widget.page])
    page.wait_for_function("model.get('settings') === 'machine=zittau_axial'")
    page.evaluate("model.change('machine=zittau_axial&p.kp=2500')")
    frame = page.frame_locator("iframe")
    frame.locator("button.value:has-text('2500 A/m')").wait_for()
    frame.locator("#knob-kd").fill("700")
    page.wait_for_function("model.get('settings').includes('p.kp=2500&p.kd=')")


@pytest.mark.long
def test_four_filters_over_a_second_are_drawn(page):
    times = page.evaluate("ask.times()")
    assert (times["n"], times["filters"]) == (10001, 4)
    assert min(times["took"]) > 0  # milliseconds
