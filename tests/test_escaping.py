"""Texts that others wrote stay texts: in each language by itself, then in every template."""

import html
import json
import re
import shutil
import subprocess
import tomllib
import zipfile
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest
from exporting import export_c, export_fmu
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import Environment

import ambkit
from ambkit import PID, Machine, Scenario
from ambkit.base import escaping
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.cli import printing
from ambkit.data.reading import read
from ambkit.data.reading.reading_figure import reading_figure
from ambkit.fuzzy.expert import Expert
from ambkit.machine.stiffness import stiffness_map
from ambkit.result.report import (
    Axis,
    Chapter,
    Figure,
    FigureBlock,
    Line,
    Panel,
    Report,
    TableBlock,
    markup,
    write_report,
)
from ambkit.result.report import Text as Paragraph
from ambkit.result.tables import table
from tests.hostile import NOT_PRINTABLE, TEXTS, Page, called

BEARING = Machine.preset("zittau_axial")
PLAIN, WORST = "harmless", "".join(TEXTS)
C_KINDS = ("linear", "adaptive", "extended")
FMUS = (("estimator", 3), ("plant", 2), ("closed-loop", 3))
TEMPLATES = sorted(Path(ambkit.__file__).parent.rglob("*.j2"))


class Made(NamedTuple):
    """Where everything was written, and the templates that were filled in for it."""

    folder: Path
    templates: set[str]


any_text = st.text(st.characters(exclude_categories=["Cs"])) | st.sampled_from(TEXTS)
marks = st.text("\\`*_{}[]()<>#+-.!|~$&:@/?'\"% \n1ak", max_size=12)
texts = any_text | marks


@given(texts)
def test_a_terminal_gets_one_line_that_can_be_printed(text):
    shown = escaping.one_line(text)
    assert re.sub(r"[^\S ]", " ", shown).isprintable()  # spaces of any width
    assert shown == escaping.one_line(shown)
    assert text != shown or "\n" not in text


@given(texts)
def test_markdown_shows_the_text_and_nothing_else(text):
    plain = escaping.one_line(text).strip()
    written = escaping.markdown(text)
    for around in ("", "k_i of "):
        shown = markup.inline(f"{around}{written}").removeprefix(markup.inline(around))
        assert "<" not in shown
        assert html.unescape(shown).strip() == plain
    assert markup.plain(written) == plain
    paragraph = markup.markdown(written)
    assert re.sub(r"^<p>|</p>$", "", paragraph.strip()).count("<") == 0


@given(texts)
def test_labels_show_the_text_and_nothing_else(text):
    shown = markup.label_html(escaping.label(text))
    assert "<" not in shown
    assert html.unescape(shown) == escaping.one_line(text)


@given(texts)
def test_nothing_ends_a_comment_of_c(text):
    written = escaping.c_comment(text)
    assert not re.search(r"\*/|/\*|//|\?\?|\n|\r", f"{written} ")


@given(texts)
def test_strings_of_toml_and_json_read_back_and_can_be_printed(text):
    toml, found = escaping.toml_string(text), escaping.json_text({"a": text})
    assert tomllib.loads(f"a = {toml}") == json.loads(found) == {"a": text}
    assert escaping.one_line(toml) == toml
    assert escaping.one_line(found) == found


@pytest.mark.parametrize("text", [*NOT_PRINTABLE, "x" * 81, ""])
def test_a_name_is_one_short_line_that_can_be_printed(text):
    toml = BEARING.to_toml().replace('"zittau_axial"', escaping.toml_string(text), 1)
    with pytest.raises(ConfigError, match=r"b\.toml:1: name: must (be one line|have at )"):
        Machine.from_toml(toml, "b.toml")
    with pytest.raises(ConfigError, match=r"Machine\.name: must"):
        BEARING.replace(name=text)


def test_a_description_has_lines_and_no_control_characters():
    assert BEARING.replace(description="two\n\tlines").description == "two\n\tlines"
    with pytest.raises(ConfigError, match=r"description: must be text without control characters"):
        BEARING.replace(description="a\x1b[31m")


def expert(text):
    return Expert.from_map(stiffness_map(BEARING)).model_copy(update={"source": text})


def export(out, kind, text):
    """Write a folder of C for a bearing and an expert that are called by a text."""
    magnet = expert(text) if kind == "adaptive" else None
    export_c(called(BEARING, text), magnet, out, kind=kind, prefix="flt")


def export_controllers(out, text):
    """Write whole controllers in C, of an axis with calibration and telemetry, and of a machine."""
    scenario = Scenario(duration=0.1, controller=PID.for_bearing(BEARING))
    axis = called(BEARING, text)
    export_c(axis, None, out / "axis", prefix="flt", scenario=scenario, calibrated=True,
             telemetry=True)  # fmt: skip
    update = {"name": text, "description": text, "source": text}
    machine = Machine.preset("hindawi_2011").model_copy(update=update)
    export_c(machine, None, out / "machine", prefix="flt", scenario=Scenario(duration=0.05))
    export_c(machine, None, out / "editable", prefix="flt", editable=True)
    export_c(axis, None, out / "faults", prefix="flt", kind="extended", faults=True)


def wave(text):
    """A figure with a text wherever others may have put one."""
    t = np.linspace(0, 1, 50)
    label, shown = escaping.label(text), escaping.markdown(text)
    panel = Panel(Axis(label, "s"), Axis(label), [Line(t, np.sin(t), label=label)], title=label)
    return Figure("wave", f"Run of {shown}", f"{shown} is shown.", [panel])


def report(text):
    """A report with a text wherever others may have put one."""
    shown = escaping.markdown(text)
    table = TableBlock("t", shown, [shown, "b"], [[shown, 1.0]], shown, highlight={(0, 1): shown})
    blocks = [Paragraph(f"{shown}\n\n- {shown}"), FigureBlock(wave(text)), table]
    chapter = Chapter("c", shown, blocks, lead=shown)
    return Report(text, text, shown, "1", [chapter], facts={text: text})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Everything that is written from templates, once for a plain name and once for the worst."""
    folder, templates = tmp_path_factory.mktemp("made"), set()
    get = Environment.get_template

    def counting(self, name, *rest, **more):
        templates.add(str(name))
        return get(self, name, *rest, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Environment, "get_template", counting)
        for name, text in (("plain", PLAIN), ("worst", WORST)):
            for kind in C_KINDS:
                export(folder / name / kind, kind, text)
            export_controllers(folder / name / "controllers", text)
            write_report(report(text), folder / name)
        for kind, fmi in FMUS:
            export_fmu(called(BEARING, WORST), None, folder / f"{kind}.fmu", kind=kind, fmi=fmi)
    return Made(folder, templates)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_every_template_is_filled_in_with_the_worst(made):
    assert {path.name for path in TEMPLATES} == made.templates


def without_comments(text):
    """Return C without its comments and the hash of what it was made from."""
    bare = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    bare = re.sub(r"0x[0-9A-F]{4}U\) << 16\) \| 0x[0-9A-F]{4}U", "", bare)
    return re.sub(r"[0-9a-f]{16}", "", bare)


def check_export(plain, hostile, text):
    """Check that nothing but comments and prose differs."""
    for path in plain.rglob("*.*"):
        written = (hostile / path.relative_to(plain)).read_text(encoding="utf-8")
        asked = path.read_text(encoding="utf-8")
        assert all(line.replace("\t", " ").isprintable() for line in written.split("\n")), path.name
        if path.suffix in (".c", ".h"):
            assert without_comments(written) == without_comments(asked), path.name
        elif path.suffix == ".txt":
            build = [re.sub("(?m)^#.*$", "", each) for each in (written, asked)]
            assert build[0] == build[1], path.name
        elif path.suffix == ".md":
            page = Page(markup.markdown(written))
            assert page.found == []
            if path.parent == plain:  # those of self-test and proof tell of the prefix alone
                assert escaping.one_line(text).strip() in page.text


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("kind", [*C_KINDS, "controllers/axis", "controllers/machine"])
def test_no_name_changes_the_c_or_its_build(kind, made):
    check_export(made.folder / "plain" / kind, made.folder / "worst" / kind, WORST)


@pytest.mark.parametrize("text", TEXTS)
def test_nor_does_a_name_by_itself(text, tmp_path):
    export(tmp_path / "plain", "linear", PLAIN)
    export(tmp_path / "hostile", "linear", text)
    check_export(tmp_path / "plain", tmp_path / "hostile", text)


@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no cmake")
def test_the_worst_name_builds_and_runs_nothing(tmp_path):
    export(tmp_path / "c", "adaptive", WORST)
    for command in (
        ["cmake", "-S", ".", "-B", "build"],
        ["cmake", "--build", "build"],
        ["build/selftest"],
    ):
        done = subprocess.run(command, cwd=tmp_path / "c", capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stdout + done.stderr
    assert not list(tmp_path.rglob("PWNED"))


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize(("kind", "fmi"), FMUS)
def test_an_fmu_of_any_name_is_sound(kind, fmi, made):
    with zipfile.ZipFile(made.folder / f"{kind}.fmu") as archive:
        description = ElementTree.fromstring(archive.read("modelDescription.xml"))
        page = Page(archive.read("documentation/index.html").decode())
        names = archive.namelist()
    assert description.attrib["modelName"] == f"{escaping.one_line(WORST)} {kind}"
    assert description.attrib["fmiVersion"] == f"{fmi}.0"
    assert (page.found, page.scripts) == ([], 0)
    assert escaping.one_line(WORST) in page.text
    assert all(re.fullmatch(r"[\w./-]+", name, re.ASCII) for name in names)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_a_report_loads_and_runs_nothing(made):
    plain, worst = (
        Page((made.folder / name / "report.html").read_text(encoding="utf-8"))
        for name in ("plain", "worst")
    )
    assert worst.found == []
    assert worst.scripts == plain.scripts
    assert worst.text.count(escaping.one_line(WORST)) >= plain.text.count(PLAIN)
    ElementTree.parse(made.folder / "worst" / "figures" / "wave.svg")


@pytest.mark.parametrize("text", TEXTS)
def test_a_page_bears_any_text(text, tmp_path):
    page = Page(wave(text).save(tmp_path / "p.html").read_text(encoding="utf-8"))
    assert (page.found, page.scripts) == ([], 3)
    assert page.text.count(escaping.one_line(text).strip()) >= 3  # title, heading, caption


def test_a_picture_in_markdown_is_no_picture():
    assert "<img" not in markup.markdown("![i](http://evil.example/x.png)")


@pytest.mark.parametrize("text", TEXTS)
def test_pictures_of_a_log_bear_any_name(text, tmp_path):
    """From the file to the page: names of channels, and the name of the file."""
    name = re.sub(r"[/\x00]", "_", text)[:60] + ".csv"
    head = re.sub(r"[\n\r\x00]", " ", text).replace('"', '""')
    rows = [f"{k * 1e-3},{np.sin(k / 9):.5f},{np.cos(k / 7):.5f}" for k in range(300)]
    (tmp_path / name).write_text("\n".join([f't [s],y [mm],"{head} [V]"', *rows]) + "\n", "utf-8")
    reading = read(tmp_path / name)
    path = reading_figure(reading).save(tmp_path / "p.html")
    page = Page(path.read_text(encoding="utf-8"))
    assert (page.found, page.scripts) == ([], 3)
    reading.record.save(tmp_path / "again.csv")
    assert list(ambkit.Record.load(tmp_path / "again.csv")) == list(reading.record)
    assert escaping.one_line(list(reading.record)[1]) == list(reading.record)[1]


@pytest.mark.parametrize("text", NOT_PRINTABLE)
def test_errors_and_tables_do_not_move_the_cursor(text, call, capsys):
    assert escaping.lines(text) == str(AmbkitError(text))
    printing.note(text)
    printing.show([table(text, [text, text], [[text, "[red]1[/red]"]]), text])
    printing.deliver({"name": text}, [], as_json=True)
    said = capsys.readouterr()
    for stream in said:
        assert all(map(str.isprintable, stream.split("\n")))
    assert "[red]1[/red]" in said.out
    told = call("check", text.replace("/", "").replace("\x00", ""))
    assert told.code == 2
    assert all(map(str.isprintable, told.err.split("\n")))


def test_a_key_of_toml_is_reported_in_one_line():
    with pytest.raises(ConfigError, match=r"b\.toml:1: evil\\nb\.toml:9: mass: unknown key"):
        Machine.from_toml('"evil\\nb.toml:9: mass" = 1\n' + BEARING.to_toml(), "b.toml")


def test_half_a_character_in_an_expert_is_reported(tmp_path):
    text = expert("x").model_dump_json().replace('"source":"x"', r'"source":"a\ud800"')
    (tmp_path / "e.json").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r'e\.json:1: source: .*, is "a\\ud800"$'):
        Expert.load(tmp_path / "e.json")


def test_what_is_written_as_toml_is_printable():
    data = {"a": "x\x1b\u202e\U000e0001", "\x1b": 1, "t": {"b\t": ["\t\n\x85", {"\u2028": 0.1}]}}
    text = escaping.toml_text(data)
    assert all(map(str.isprintable, text.split("\n")))
    assert tomllib.loads(text) == data


@pytest.mark.parametrize("prefix", ["test", "selftest", "math", "STDIO", "clean"])
def test_a_prefix_is_no_header_and_no_target(prefix, tmp_path):
    with pytest.raises(AmbkitError, match="prefix must not be"):
        export_c(BEARING, None, tmp_path / "c", prefix=prefix)
