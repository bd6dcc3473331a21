"""Files, functions and lists of parameters stay short; what does not is named with the reason.

Complexity is held by ruff, see C901 in pyproject.toml.
"""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "ambkit"
LINES, BODY, PARAMETERS = 400, 60, 8  # a body is counted without its docstring

VERB = "it does what a verb of that name is called for, and takes its options"
PUBLIC = "it is public, and each of these is a choice of the user's"
MANY_PARAMETERS = {
    "estimate/batch:run_many": PUBLIC,
    "estimate/estimator:__init__": PUBLIC,
    "export/c/exporter:export_c": VERB,
    "fuzzy/training:train": PUBLIC,
    "identification/excitation/design:design": VERB,
    "identification/maximum_likelihood/estimate:maximum_likelihood": VERB,
    "judge/comparison/study:across": VERB,
    "judge/comparison/study:study": VERB,
    "judge/faults/fault_test:inject_faults": VERB,
    "workflow/comparison:in_case": VERB,
    "workflow/comparison:in_loops": VERB,
    "workflow/design:design": VERB,
    "workflow/filter_record:filtered": VERB,
    "workflow/identify:by_likelihood": VERB,
    "workflow/identify:identify": VERB,
    "workflow/simulate:scenario_for": PUBLIC,
    "workflow/trade_off:trade_off": VERB,
    "workflow/training:trained_on_map": VERB,
    "workflow/tune:tune": VERB,
}


def parameters(function):
    arguments = function.args
    names = [a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def body(function):
    """Return the lines of a function without its parameters and its docstring."""
    has_docstring = ast.get_docstring(function, clean=False) is not None
    statements = function.body[has_docstring:] or function.body
    return (function.end_lineno or 0) - statements[0].lineno + 1


def test_files_are_short():
    sizes = {
        path.relative_to(PACKAGE).as_posix(): len(path.read_text().splitlines())
        for path in PACKAGE.rglob("*.py")
    }
    assert {name for name, lines in sizes.items() if lines > LINES} == set()


def test_functions_are_short_and_take_few_parameters():
    long, many = set(), set()
    for path in PACKAGE.rglob("*.py"):
        if path.parent.name == "verbs":
            continue
        module = path.relative_to(PACKAGE).with_suffix("").as_posix()
        for function in ast.walk(ast.parse(path.read_text())):
            if isinstance(function, ast.FunctionDef):
                name = f"{module}:{function.name}"
                long |= {name} if body(function) > BODY else set()
                many |= {name} if parameters(function) > PARAMETERS else set()
    assert long == set()
    assert many == MANY_PARAMETERS.keys()
