"""What a self-test cannot see, and why: faults that change nothing, and lines that do not run.

``tests/mutants.py`` plants faults in the operators; what its tests let live must be in these lists.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Unseen(NamedTuple):
    """A line whose operators can be others, or some of them, without a difference."""

    file: str  # how its name ends
    text: str  # in the line
    why: str
    function: str = ""  # that it stands in; any, where it is empty


class Has(NamedTuple):
    """What decides which lines of a machine's export run."""

    states: int
    direct: bool  # whether controls act on the states past the magnets
    rising: bool  # whether the noise of a sensor depends on where the rotor is
    controlled: bool = False
    fed: bool = False  # controllers see the estimate
    gains: bool = False  # states are fed back besides the PIDs
    let_turn: bool = False
    schedule: bool = False  # gains of the PIDs follow the speed
    isolated: bool = False  # each axis has a PID of its own, and nothing else acts on it
    tracking: bool = False  # integrals follow what is left of a demand
    rounded: bool = False  # the readings of a sensor come in steps


class NotRun(NamedTuple):
    """Lines that a machine's self-test does not run, for they have nothing to do there."""

    file: str
    function: str
    text: str  # in the lines; all of the function where it is empty
    why: str
    of: Callable[[Has], bool]


_ONE = "of a single reading, or of kinds of filters that this is not"
_DIRECT = "no control signal acts on the states past the magnets"
_TURN = "no motion is left to the rotor"
_ROUNDED = "no sensor's readings come in steps"
_TOO_FAR = "no reading or current is so large"
_FIRST = "the first sample is a start, without a control"
_EVEN = "the noise of each sensor is the same everywhere"

NOT_RUN = (
    NotRun(
        "real.h", "amb_noise_share", "", _EVEN, lambda has: not has.rising,
    ),
    NotRun("kalman_step.h", "amb_step_noise", "share) * share", _EVEN, lambda h: not h.rising),
    NotRun(
        "kalman_step.h", "amb_step_advance", "F[f] = scale", "of kinds of filters that this is not",
        lambda _: True,
    ),
    NotRun("equilibrium.c", "amb_rest_where_shown", "", _ONE, lambda _: True),
    NotRun(
        "control.c", "amb_working_by", "else if (works_by->copy[0]", "for bits that flip in memory",
        lambda _: True,
    ),
    *(
        NotRun("envelope.c", function, "", _ONE, lambda _: True)
        for function in (
            "place_there", "place_towards", "amb_envelope_place", "add_square", "clear",
            "restart_there",
        )
    ),
    NotRun(
        "magnet.c", "constant_force", "", "asked by kinds of filters that this is not",
        lambda _: True,
    ),
    NotRun("loops.c", "add_up", "j < wanted", "of fewer than 8 states", lambda h: h.states >= 8),
    NotRun(
        "loops.c", "add_up", "sum->row[", "of fewer than 8 states", lambda has: has.states >= 8
    ),
    NotRun(
        "loops.c", "add_up", "k < sum->count", "of fewer than 8 states",
        lambda has: has.states >= 8,
    ),
    NotRun(
        "loops.c", "turn", "; j < end; j++", "of states that are no multiple of 4",
        lambda has: has.states % 4 == 0,
    ),
    NotRun(
        "loops.c", "turn", "r < rows", "of states that are no multiple of 4",
        lambda has: has.states % 4 == 0,
    ),
    NotRun(
        "loops.c", "turn", "apart -= less", "of states that are no multiple of 4",
        lambda has: has.states % 4 == 0,
    ),
    NotRun(
        "loops.c", "amb_model_update", "cov[amb_entry(n, n - 1, n - 1)] -=",
        "of an odd number of states", lambda has: has.states % 2 == 0,
    ),
    NotRun(
        "loops.c", "amb_model_predict_mean", "model->B_u.value[k]", _DIRECT,
        lambda has: not has.direct,
    ),
    NotRun(
        "loops.c", "pushes", "model->B_u.value[a]", _DIRECT, lambda has: not has.direct
    ),
    NotRun("loops.c", "with_control", "", _DIRECT, lambda has: not has.direct),
    NotRun(
        "loops.c", "with_next_state", "noise->gain[f][c]", _DIRECT, lambda has: not has.direct
    ),
    NotRun("loops.c", "next_column", "model->B_u.value[a]", _DIRECT, lambda h: not h.direct),
    NotRun("control.c", "see", "r < amb_sensors(model)", "the estimate feeds it", lambda h: h.fed),
    NotRun(
        "control.c", "see", "i < amb_states(model)", "the readings feed it", lambda h: not h.fed
    ),
    NotRun("control.c", "see", "AMB_LOAD", "the readings feed it", lambda has: not has.fed),
    NotRun(
        "controller.c", "amb_pid_step", "status |= AMB_MISSING", "estimates are finite",
        lambda has: has.fed,
    ),
    *(
        NotRun(
            "controller.c", "amb_pid_step", text, "the estimate has the velocity",
            lambda has: has.fed,
        )
        for text in ("state->velocity +=", "FASTEST", "state->velocity = amb_clamp(")
    ),
    NotRun(
        "controller.c", "amb_pid_step", "((velocity != NULL) &&", "readings have no velocity",
        lambda has: not has.fed,
    ),
    NotRun(
        "controller.c", "amb_pid_step", "!saturated", "integrals follow what is left of a demand",
        lambda has: has.tracking,
    ),
    NotRun(
        "controller.c", "amb_pid_step", "pid->T * pid->ki * error)",
        "integrals follow what is left of a demand", lambda has: has.tracking,
    ),
    NotRun(
        "controllers.c", "amb_controllers_step", "&c->velocity[",
        "readings have no velocity", lambda has: not has.fed,
    ),
    NotRun(
        "controllers.c", "amb_controllers_step", "status |= AMB_SATURATED",
        "each PID has held its axis to its limits", lambda has: has.isolated,
    ),
    *(
        NotRun("controller.c", function, "", "no blocks behind a PID", lambda _: True)
        for function in ("settled", "filtered")
    ),
    NotRun(
        "controllers.c", "scheduled", "", "no gains follow the speed", lambda h: not h.schedule
    ),
    *(
        NotRun("controllers.c", function, "", _TURN, lambda has: not has.let_turn)
        for function in ("find", "turned", "taken", "leave")
    ),
    *(
        NotRun("controllers.c", "amb_controllers_step", text, _TURN, lambda h: not h.let_turn)
        for text in ("i < c->let_turn->moved", "left.motion[", "left.current[")
    ),
    *(
        NotRun(file, function, "", _ROUNDED, lambda has: not has.rounded)
        for file, function in (
            ("exponential.h", "amb_exp_polynomial"), ("exponential.h", "amb_exp_negative"),
            ("real.h", "amb_at_least"), ("kalman.c", "density"), ("kalman.c", "mills"),
            ("kalman.c", "amb_kalman_rounded"), ("kalman.c", "amb_kalman_edge"),
            ("kalman.c", "amb_kalman_rests"),
        )
    ),
    *(
        NotRun("kalman_step.h", "amb_step_rounded", text, _ROUNDED, lambda has: not has.rounded)
        for text in ("const amb_real e = y", "if (AMB_WITHIN(e, AMB_REAL_ROOT)", "as = very")
    ),
    NotRun(
        "sequence.c", "mend", "AMB_LIFTING : AMB_TRIPPED", "for bits that flip in memory",
        lambda _: True,
    ),
    NotRun(
        "controllers.c", "fed_back", "dot(", "no states are fed back", lambda has: not has.gains
    ),
)  # fmt: skip
"""Of machines whose filter is the linear one, by loops or not."""


_SECANT = "an adaptive filter asks for the secant alone; the extended one's table is seen whole"

FILTER = (
    Unseen(".c", "(told & unsure) != 0U", "a variance alone is bad by rounding only"),
    Unseen("axial.h", "G00", "below the last digit in float"),
    Unseen("axial.h", "G03", "below the last digit in float"),
    Unseen("axial.h", "G33", "below the last digit in float"),
    Unseen(
        "real.h", "(a > AMB_C(0.0)) && (a <= AMB_REAL_MAX)",
        "asked of constants alone, all good",
    ),
    Unseen("kalman.c", "!amb_is_finite(mean[i]) ||", "asked of constants alone, all good"),
    Unseen("kalman.c", "for (int i = 0; i < n; i++) {", "a loop over that check, or killed"),
    Unseen("kalman.c", "near && (std != NULL)", "a start between the stops is near, and has a std"),
    Unseen("equilibrium.c", "(far > farthest)", "one position"),
    Unseen("equilibrium.c", "(position >= 0) && these[position]", "a velocity has a position"),
    Unseen(
        "equilibrium.c", "if (these[i] && (amb_model_role(model, i) == AMB_POSITION))",
        "one position",
    ),
    Unseen("equilibrium.c", "these[j] || ((amb_model_role(model, j) == AMB_SHOWN)", "one sensor"),
    Unseen("equilibrium.c", "bool seen = false;", "the residual after an outage is not asked"),
    Unseen(
        "equilibrium.c", "for (int i = 0; i < amb_states(model); i++) {",
        "as the residual, or killed",
    ),
    Unseen("equilibrium.c", "seen = seen ||", "the residual after an outage is not asked"),
    Unseen("envelope.c", "for (int r = 0; r < amb_sensors(model); r++) {", "as the residual"),
    Unseen("envelope.c", "for (int j = 0; j < n; j++) {", "clears what is clear, or killed"),
    Unseen("envelope.c", "if (j != s) {", "clears what is clear, or killed"),
    Unseen("envelope.c", "bool some = false;", "the return value is not asked"),
    Unseen(
        "envelope.c", "for (int i = 0; i < n; i++) {",
        "the return value is not asked, or killed",
    ),
    Unseen("envelope.c", "some = some ||", "the return value is not asked"),
    Unseen("envelope.c", "(moves && lost[i])", "both are lost, or none"),
    Unseen(
        "envelope.c", "lost[i] && (amb_model_role(model, i) == AMB_SHOWN)",
        "rest is the mean elsewhere",
    ),
    Unseen(
        "envelope.c", "(role == AMB_SHOWN) || amb_is_finite(variance[i])",
        "all are finite, or none",
    ),
    Unseen(
        "root.h", "(AMB_C(0.5) * inverse) * (a - root * root)",
        "within the root's own rounding",
    ),
    Unseen("kalman_step.h", "!sharp || amb_is_finite(e->variance)", "the supervisor starts anew"),
    Unseen("kalman_step.h", "const bool sharp = !(", "the supervisor starts anew"),
    Unseen(".c", "AMB_WITHIN(y, far) ?", "what starts it is between the stops"),
    Unseen("kalman_step.h", "(u < -AMB_REAL_ROOT) &&", _TOO_FAR),
    Unseen("kalman_step.h", "if (rise == AMB_C(0.0))", _EVEN),
    Unseen(
        ".c", "finite = finite && amb_is_finite(result->variance[r])",
        "for bits that flip in memory",
    ),
    Unseen(".c", "} else if (used && (state->doubted > 0U)) {", "not visited, or killed"),
    Unseen(".c", "state->doubted--;", "not visited, or killed"),
    Unseen(".c", "r < AMB_SENSORS", "held within bounds they are numbers", "has_variances"),
    Unseen(".c", "(unsure | AMB_BAD_VARIANCE)) != 0U", "one look at both, which is quicker"),
    Unseen("table.c", "const amb_real across", _SECANT, "bilinear"),
    Unseen("table.c", "s.d_iu = ", _SECANT, "bilinear"),
    Unseen("table.c", "s.d_x = ", _SECANT, "bilinear"),
    Unseen("table.c", "p.slope = ((position", _SECANT, "locate"),
    Unseen("table.c", "", _SECANT, "table_tangent"),
    Unseen("table.c", "", _SECANT, "table_force"),
)  # fmt: skip
"""Of the paper's linear filter of one axis, in float. Where the text stands more than once, or an
operator of it makes a difference, those are seen."""

_EXCESS = Unseen(
    "control.c", "share *= ", "by 1 but where a mass is calibrated, see test_calibration.py"
)

CONTROL = (
    _EXCESS,
    *(
        Unseen("", text, "for bits that flip in memory")
        for text in (
            "state->copy[", "works_by->copy[", "works_by->control", "FASTEST", "kept(state)",
            "const bool there =", "there ? AMB_C(1.0)", "state->mode > AMB_TRIPPED",
            "state->share > AMB_C(0.0)", "s->doubted > c->settling", "state->velocity = AMB_C(0.0)",
        )
    ),
    Unseen("", "out->usable = true;", "with a sequence the supervisor says it"),
    Unseen(
        "", "state->limited = false;",
        "counted only where there were currents, and set by each such step",
    ),
    Unseen("", "told |= AMB_RESTARTED;", "the envelope in the core has said so already"),
    Unseen(
        "", "for (int f = 0; f < control->law->axes; f++) {",
        "a step sets what acts, where it is off",
    ),
    Unseen("", "for (int j = 0; j < control->law->pids; j++) {", "set again as it lifts"),
    Unseen("", "j * n", "one PID"),
    Unseen("", "j * c->axes", "one PID"),
    Unseen("", "axis * c->states", "one axis"),
    Unseen("", "turning", "a machine's that is let turn"),
    Unseen("", "c->spread[(f * c->pids) + j]", "one axis"),
    Unseen("", "power *= speed", "a machine's"),
    Unseen("", "turn->", "a machine's that is let turn"),
    Unseen("", "where->", "a machine's that is let turn"),
    Unseen("", "turned(", "a machine's that is let turn"),
    Unseen("", "others", "a machine's that is let turn"),
    Unseen("", "sum += (one[j]", "a machine's that is let turn"),
    Unseen("", "left.current[", "a machine's that is let turn"),
    Unseen("controllers.c", "", "no gains follow the speed", "scheduled"),
    Unseen("controllers.c", "", "a machine's that is let turn", "taken"),
    Unseen("controllers.c", "", "a machine's that is let turn", "leave"),
    Unseen("", "(a > most) ? most : -most", _TOO_FAR),
    Unseen("", "/ kf->set.k_ui[f]", _FIRST),
    Unseen("", "at > AMB_C(0.0)", "a machine's that is let turn"),
    Unseen("", "int node = (int)at", "a machine's that is let turn"),
    Unseen("", "for (int k = 0; k < 3; k++)", "a machine's second and third"),
    Unseen("", "else if (!saturated)", "without a tracking time"),
    Unseen("", "pid->T * pid->ki * error)", "without a tracking time"),
    Unseen(
        "", "state->started = false;",
        "a first sample after another, of a PID that is fed by readings",
    ),
    Unseen("", "!AMB_WITHIN(*velocity, AMB_REAL_ROOT)", "estimates are finite"),
    Unseen("", "status |= AMB_MISSING;", "the estimator has said so"),
)  # fmt: skip
"""Of the whole controller of one axis, with what is a machine's alone."""

_RESIDUAL = "after an outage an innovation is within the gate, or far beyond what goes on from it"
_SEES = "each reading sees a position that is lost"
_RETURN = "the filter does not ask for the return value"
_GIVEN = "asked of constants and of bounded means alone, all of them good"
_UNITY = "a reading is a state, taken once"
_ROOM = "room that no sum of rows uses up"
_FLIPPED = "for bits that flip in memory"

MACHINE = (
    Unseen("controller.c", "state->started = true;", "the estimate has the velocity"),
    Unseen(
        "kalman.c", "!(step > AMB_C(0.0))", "no converter of theirs is so coarse",
        "amb_kalman_repeats",
    ),
    Unseen(
        "kalman.c", "(AMB_VERY_COARSE * var_y)", "no converter of theirs is so coarse",
        "amb_kalman_repeats",
    ),
    Unseen("real.h", "(a > AMB_C(0.0)) && (a <= AMB_REAL_MAX)", _GIVEN),
    Unseen("equilibrium.c", "bool seen = false;", _RESIDUAL, "amb_rest_sees"),
    Unseen("equilibrium.c", "i < amb_states(model)", _RESIDUAL, "amb_rest_sees"),
    Unseen("equilibrium.c", "seen = seen ||", _RESIDUAL, "amb_rest_sees"),
    Unseen("envelope.c", "r < amb_sensors(model)", _RESIDUAL, "amb_envelope_hold"),
    Unseen("equilibrium.c", "int most = -1;", "the greatest is found from any start"),
    Unseen("equilibrium.c", "if (these[i] &&", _SEES, "amb_rest_add_followers"),
    Unseen("equilibrium.c", "these[j] = these[j] ||", _SEES, "amb_rest_add_followers"),
    Unseen("envelope.c", "return !within;", _RETURN, "amb_envelope_clamp"),
    Unseen("envelope.c", "some = ", _RETURN, "amb_envelope_lost"),
    Unseen("envelope.c", "j < n", "clears what is clear already", "show"),
    Unseen("envelope.c", "if (j != s) {", "clears what is clear already", "show"),
    Unseen("envelope.c", "(role == AMB_SHOWN) ||", "all variances are finite, or none"),
    Unseen(
        "envelope.c", "bool shows = lost[i] &&", "what is at rest is the mean elsewhere",
        "rest_in_the_middle",
    ),
    Unseen("kalman.c", "i < n; i++", _GIVEN, "amb_kalman_reset"),
    Unseen("kalman.c", "!amb_is_finite(mean[i]) ||", _GIVEN, "amb_kalman_reset"),
    Unseen("kalman.c", "near && (std != NULL)", "a start is near, and has deviations"),
    Unseen("kalman.c", "kf->far[r] * kf->far[r]", "the first change is smaller"),
    Unseen("kalman.c", "{AMB_C(2.0) * kf->far[r]", "no measurement is so far away"),
    Unseen(
        "exponential.h", "/* ln 2 in two parts */",
        "what a repeat's probability is made of, which is held to a limit",
    ),
    Unseen("loops.c", "value[AMB_STATES + AMB_FORCES", _ROOM),
    Unseen("loops.c", "row[AMB_STATES + AMB_FORCES", _ROOM),
    Unseen("loops.c", "if (n >= BLOCK)", "the sums are the same, row by row and in blocks"),
    Unseen(
        "loops.c", "model->B_u.start[i]", "a loop over no entries", "amb_model_predict_mean"
    ),
    Unseen(
        "loops.c", "(i + 1) < n; i += 2", "what lies behind is room that is written anew",
        "amb_model_update",
    ),
    Unseen(".c", "AMB_WITHIN(y, far) ?", "what starts it is between the stops", "within_reach"),
    Unseen(".c", "r < AMB_SENSORS", "held within bounds they are numbers", "has_variances"),
    Unseen(".c", "finite = finite &&", "held within bounds they are numbers", "has_variances"),
    Unseen(".c", "(unsure | AMB_BAD_VARIANCE)) != 0U", "one look at both, which is quicker"),
    Unseen("loops.c", "cov[entry] * value", _UNITY, "add_row_of"),
    Unseen("loops.c", "row[j - k] * value", _UNITY, "add_row_of"),
    Unseen("loops.c", "* model->c.value[a];", _UNITY, "amb_model_shown_variance"),
    Unseen("loops.c", "(direct > 0) &&", "of controls past the magnets: none, or below a digit"),
    Unseen("loops.c", "room.v = ", "there is nothing in that room"),
    Unseen("loops.c", "room.u = ", "there is nothing in that room"),
    Unseen("loops.c", "if (rows == 4)", "the same without a loop, which is quicker"),
    _EXCESS,
    Unseen("control.c", "j < control->law->pids", "PIDs are set again as it lifts, or were just"),
    Unseen(
        "control.c", "state->limited = false;", "where it is off no current counts",
        "amb_control_init",
    ),
    Unseen(
        "control.c", "/ kf->set.k_ui[f]", _FIRST,
        "amb_control_levitate",
    ),
    Unseen("control.c", "out->usable = true;", "the supervisor says it"),
    Unseen("control.c", "(a > most) ? most : -most", _TOO_FAR),
    Unseen("control.c", "works_by->copy[", _FLIPPED),
    Unseen("controller.c", "state->copy[", _FLIPPED),
    Unseen("controller.c", "(pid->sections > 0) ?", "no blocks, by which nothing is filtered"),
    Unseen("sequence.c", "const bool there =", _FLIPPED),
    Unseen("real.h", "i < n; i++", _GIVEN, "amb_all_within"),
    Unseen("real.h", "within = within &&", _GIVEN, "amb_all_within"),
    Unseen(
        "kalman_step.h", "(u < -AMB_REAL_ROOT) &&",
        "what is near, or above the root, went another way before",
    ),
    Unseen(
        "kalman_step.h", "amb_clamp(s, -x_max, x_max)",
        "the stiffnesses are the same wherever the rotor is",
    ),
    Unseen("kalman_step.h", "if (rise == AMB_C(0.0))", _EVEN),
)  # fmt: skip
"""Of a machine's linear filter and its controllers."""

UNROUNDED = (
    Unseen("", "kf->rounding[", _ROUNDED),
    *(
        Unseen("kalman_step.h", text, _ROUNDED)
        for text in (
            "kf->set.step[r]) > (than", "const bool again = !(", "bool coarse = very || (interval",
            "as.moved", "const bool told = (status", "const amb_real grown = before",
            "const amb_real change = y", "return amb_step_each(amb_step_plain, kf, NULL",
            "if (coarse && !stays) {",
        )
    ),
)  # fmt: skip
"""Of a machine or an axis whose readings do not come in steps."""


def lists(of_machine: bool, controlled: bool, rounded: bool) -> tuple[Unseen, ...]:
    """Return what is known of an export: of a machine or an axis, a filter or a controller."""
    known = MACHINE if of_machine else CONTROL if controlled else FILTER
    return known if rounded else known + UNROUNDED


def not_run(has: Has) -> list[NotRun]:
    """Return what does not run in the self-test of a machine."""
    return [each for each in NOT_RUN if each.of(has)]
