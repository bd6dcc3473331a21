"""The number of rules: as many as measured points carry, and no more."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from ambkit import AmbkitError, Bearing, ClosedLaw
from ambkit.cli import app
from ambkit.fuzzy.choice import Candidate, RuleChoice, choose_rules, measured_map
from ambkit.fuzzy.training import train
from ambkit.identification.force_map import ForceMap
from ambkit.identification.force_table import ForceTable

BEARING = Bearing.preset("zittau_axial")
FEW = ((2, 2), (3, 3), (4, 4))
QUICK = {"weights": True, "epochs": 12, "samples": 15}


def measured(force, noise, lines=7, seed=1, known=True):
    """Points of a force on a grid over the whole box, with noise."""
    iu, x = np.linspace(-1.5, 1.5, lines), np.linspace(-0.5e-3, 0.5e-3, lines)
    values = np.asarray(force(*np.meshgrid(iu, x)))
    values = values + noise * np.random.default_rng(seed).normal(size=values.shape)
    return ForceTable(iu, x, values, np.full(values.shape, noise) if known else None)


def straight(iu, x):
    return 8 * iu + 20e3 * x


closed = ClosedLaw(BEARING).force


@pytest.fixture(scope="module")
def carried():
    return choose_rules(BEARING, measured(closed, 0.1), candidates=FEW, **QUICK)


@pytest.mark.parametrize("noise", [0.1, 3.0])
def test_a_straight_force_needs_the_fewest_rules_whatever_the_noise(noise):
    found = choose_rules(BEARING, measured(straight, noise), candidates=FEW, **QUICK)
    assert found.chosen.shape == (2, 2)
    assert 1 < found.chosen.error < 2  # little more than the noise of the points that judge


def test_more_rules_where_the_points_carry_them(carried):
    assert carried.chosen.rules >= 9
    assert carried.candidates[0].error > carried.limit + carried.candidates[0].standard_error


def test_the_same_force_drowned_in_noise_gets_fewer(carried):
    drowned = choose_rules(BEARING, measured(closed, 3.0), candidates=FEW, **QUICK)
    assert drowned.chosen.shape == (2, 2) != carried.chosen.shape


def test_noise_alone_adds_no_rules():
    found = choose_rules(BEARING, measured(lambda iu, x: 0 * iu, 1.0), candidates=FEW, **QUICK)
    assert found.chosen.shape == (2, 2)


def test_points_known_badly_do_not_ask_for_rules():
    """A bump as large as the doubt about it, and the same bump measured well."""

    def bumped(doubt):
        table = measured(straight, 0.1)
        values, errors = table.values.copy(), table.standard_error.copy()
        values[:, 4:6] += 8 * np.cos(np.pi * np.linspace(-1, 1, 7))[:, np.newaxis]
        errors[:, 4:6] = doubt
        return ForceTable(table.current, table.displacement, values, errors)

    known, doubted = (
        choose_rules(BEARING, bumped(doubt), candidates=FEW, **QUICK) for doubt in (0.1, 8.0)
    )
    assert known.chosen.rules > 4
    assert doubted.chosen.shape == (2, 2)


def test_threads_do_not_change_the_result():
    table = measured(closed, 0.5, lines=6)
    one, four = (
        choose_rules(BEARING, table, candidates=FEW[:2], threads=n, **QUICK) for n in (1, 4)
    )
    assert one == four


def test_errors_are_those_of_a_plain_loop():
    """Leave out by hand; five lines have three inner ones, each left out by itself."""
    table = measured(closed, 0.5, lines=5)
    found = choose_rules(BEARING, table, candidates=[(3, 2)], **QUICK)
    squares = []
    for axis, nodes in ((1, table.current), (0, table.displacement)):
        for k in (1, 2, 3):
            rest = [table.current, table.displacement]
            rest[1 - axis] = np.delete(nodes, k)
            part = ForceTable(
                *rest, np.delete(table.values, k, axis), np.delete(table.standard_error, k, axis)
            )
            expert = train(measured_map(BEARING, part, (3, 2)), **QUICK)
            z = []
            for j in range(5):
                row, column = (j, k) if axis == 1 else (k, j)
                force = expert.force(table.current[column], table.displacement[row])
                z.append((float(force) - table.values[row, column]) / 0.5)
            squares.append(np.mean(np.square(z)))
    assert found.folds == 6
    assert found.best.error == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-9)
    spread = np.std(squares, ddof=1) / np.sqrt(6) / (2 * found.best.error)
    assert found.best.standard_error == pytest.approx(spread, rel=1e-9)


def test_one_standard_error_rule():
    a, b, c = Candidate((2, 2), 1.5, 0.1), Candidate((3, 2), 1.15, 0.3), Candidate((2, 3), 1.1, 0.3)
    best = Candidate((5, 5), 1.0, 0.2)
    found = RuleChoice((a, b, c, best), weighted=True, folds=8)
    assert found.best is best
    assert found.limit == pytest.approx(1.2)
    assert found.chosen is c  # of two with six rules the better one


def test_without_standard_errors_it_is_newtons():
    known, unknown = (
        choose_rules(
            BEARING, measured(straight, 2.0, lines=5, known=k), candidates=FEW[:1], **QUICK
        )
        for k in (True, False)
    )
    assert (known.weighted, unknown.weighted) == (True, False)
    assert unknown.best.error == pytest.approx(2.0 * known.best.error, rel=1e-6)


@pytest.mark.parametrize(
    ("lines", "candidates", "message"),
    [
        (
            4,
            None,
            "too few points .* 5 currents and 5 displacements .* there are 4 currents, 2 of them",
        ),
        (5, [(5, 5)], "5x5 rules cannot be judged; these points allow 2x2 to 4x4"),
        (5, [(1, 3)], "1x3 rules cannot be judged"),
    ],
)
def test_too_few_points_are_told(lines, candidates, message):
    with pytest.raises(AmbkitError, match=message):
        choose_rules(BEARING, measured(straight, 1.0, lines=lines), candidates=candidates)


def saved(table, path):
    errors = table.standard_error
    ForceMap(table.current, table.displacement, table.values, errors, table.values, 1.0).save(path)
    return str(path)


def test_command_chooses_says_so_and_draws_it(tmp_path):
    force = saved(measured(straight, 0.5, lines=5), tmp_path / "force.csv")
    picture, expert = tmp_path / "choice.png", tmp_path / "expert.json"
    arguments = ["train", "zittau_axial", "--map", force, "--rules", "auto", "--no-weights"]
    found = CliRunner().invoke(
        app, [*arguments, "--plot", str(picture), "--out", str(expert), "--json"]
    )
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)
    shapes = {c["shape"]: c for c in told["choice"]["candidates"]}
    assert told["rules"] == shapes[told["choice"]["chosen"]]["rules"]
    assert shapes[told["choice"]["chosen"]]["error"] <= told["choice"]["limit"]
    assert len(json.loads(expert.read_text())["rules"]) == told["rules"]
    assert picture.stat().st_size > 20_000


def test_command_names_the_file_with_too_few_points(tmp_path):
    force = saved(measured(straight, 0.5, lines=4), tmp_path / "force.csv")
    found = CliRunner().invoke(app, ["train", "zittau_axial", "--map", force, "--rules", "auto"])
    assert found.exit_code != 0
    assert "force.csv: too few points" in str(found.exception)


def test_command_takes_a_number_of_rules():
    found = CliRunner().invoke(app, ["train", "zittau_axial", "--rules", "4x3", "--json"])
    assert json.loads(found.stdout)["rules"] == 12


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ("auto", "auto needs points that were measured"),
        ("9x9", "64 or less in total, is 9x9"),
        ("1x5", "2 or more in each direction"),
        ("many", "such as 7x5, is 'many'"),
    ],
)
def test_command_says_what_rules_may_be(rules, message):
    found = CliRunner().invoke(app, ["train", "zittau_axial", "--rules", rules])
    assert found.exit_code == 2
    assert message in " ".join(found.output.replace("│", " ").split())
