"""What a self-test cannot see, and why: faults that change nothing, and lines that do not run.

``tests/mutants.py`` plants faults in the operators; what its tests let live must be in these lists.
"""

from collections.abc import Callable
from itertools import product
from typing import NamedTuple


class UndetectedFault(NamedTuple):
    """A line whose operators can be others, or that does not run, without a difference."""

    file: str  # how its name ends
    text: str  # in the line
    why: str
    function: str = ""  # that it stands in; any, where it is empty


def listed(text: str) -> tuple[UndetectedFault, ...]:
    """Read lists of lines: a reason, and below it ``file@functions  text  text`` of each place."""
    found, why = [], ""
    for line in text.strip().splitlines():
        if not line.startswith(" "):
            why = line.removesuffix(":")
            continue
        where, *texts = line.strip().split("  ")
        file, _, functions = where.partition("@")
        each = product(functions.split(","), texts or [""])
        found += [
            UndetectedFault(file.removeprefix("*"), text, why, function) for function, text in each
        ]
    return tuple(found)


class ModelFeatures(NamedTuple):
    """What decides which lines of a machine's export run."""

    states: int
    direct: bool  # whether controls act on the states past the magnets
    rising: bool  # whether the noise of a sensor depends on where the rotor is
    controlled: bool = False
    fed: bool = False  # controllers see the estimate
    gains: bool = False  # states are fed back besides the PIDs
    unbalance_control: bool = False
    schedule: bool = False  # gains of the PIDs follow the speed
    isolated: bool = False  # each axis has a PID of its own, and nothing else acts on it
    tracking: bool = False  # integrals follow what is left of a demand
    rounded: bool = False  # the readings of a sensor come in steps


NOT_RUN: tuple[tuple[Callable[[ModelFeatures], bool], str], ...] = (
    (lambda has: not has.rising, """
the noise of each sensor is the same everywhere:
    real.h@amb_noise_share
    kalman_sensor.h@amb_step_noise  share) * share
"""),
    (lambda _: True, """
of kinds of filters that this is not:
    kalman_prediction.h@amb_step_advance  F[f] = scale
of a single reading, or of kinds of filters that this is not:
    equilibrium.c@amb_rest_where_shown
    envelope.c@place_at_reading,place_nearest,amb_envelope_place,add_square,clear,restart_one_sensor
for bits that flip in memory:
    control.c@amb_working_by  else if (works_by->copy[0]
    sequence.c@mend  AMB_LIFTING : AMB_TRIPPED
asked by kinds of filters that this is not:
    magnet.c@constant_force
no blocks behind a PID:
    controller.c@settled,filtered
"""),
    (lambda has: has.states >= 8, """
of fewer than 8 states:
    covariance_loops.c@add_up  j < columns  sum->row[  k < sum->count
"""),
    (lambda has: has.states % 4 == 0, """
of states that are no multiple of 4:
    covariance_loops.c@transpose_rows  ; j < end; j++  r < rows  apart -= less
"""),
    (lambda has: has.states % 2 == 0, """
of an odd number of states:
    loops.c@amb_model_update  cov[amb_entry(n, n - 1, n - 1)] -=
"""),
    (lambda has: not has.direct, """
no control signal acts on the states past the magnets:
    loops.c@amb_model_predict_mean  model->B_u.value[k]
    covariance_loops.c@set_input_rows  model->B_u.value[a]
    covariance_loops.c@set_control_covariance
    covariance_loops.c@set_next_force_covariance  noise->gain[f][c]
    covariance_loops.c@next_column  model->B_u.value[a]
"""),
    (lambda has: has.fed, """
the estimate feeds it:
    control.c@see  r < amb_sensors(model)
estimates are finite:
    controller.c@amb_pid_step  status |= AMB_MISSING
the estimate has the velocity:
    controller.c@amb_pid_step  state->velocity +=  FASTEST  state->velocity = amb_clamp(
"""),
    (lambda has: not has.fed, """
the readings feed it:
    control.c@see  i < amb_states(model)  AMB_LOAD
readings have no velocity:
    controller.c@amb_pid_step  ((velocity != NULL) &&
    controllers.c@amb_controllers_step  &c->velocity[
"""),
    (lambda has: has.tracking, """
integrals follow what is left of a demand:
    controller.c@amb_pid_step  !saturated  pid->T * pid->ki * error)
"""),
    (lambda has: has.isolated, """
each PID has held its axis to its limits:
    controllers.c@amb_controllers_step  status |= AMB_SATURATED
"""),
    (lambda has: not has.schedule, """
no gains follow the speed:
    controllers.c@scheduled
"""),
    (lambda has: not has.unbalance_control, """
no motion is left to the rotor:
    controllers.c@find,interpolated,largest_share,find_uncontrolled
    controllers.c@amb_controllers_step  i < c->unbalance_control->moved  left.motion[  left.current[
"""),
    (lambda has: not has.rounded, """
no sensor's readings come in steps:
    exponential.h@amb_exp_polynomial,amb_exp_negative
    kalman.c@density,mills,amb_kalman_rounded,amb_kalman_edge,amb_kalman_rests
    kalman_step.h@amb_step_rounded  const amb_real e = y  if (AMB_WITHIN(e, AMB_REAL_ROOT)
    kalman_step.h@amb_step_rounded  as = very
"""),
    (lambda has: not (has.rounded or has.controlled), """
no sensor's readings come in steps, and nothing is controlled:
    real.h@amb_at_least
"""),
    (lambda has: not has.gains, """
no states are fed back:
    controllers.c@fed_back  dot(
"""),
)  # fmt: skip
"""Lines that a machine's self-test does not run, as they have nothing to do there: when, and which.
Of machines whose filter is the linear one, by loops or not."""

FILTER = listed("""
a variance alone is bad by rounding only:
    .c  (flags & unsure) != 0U
below the last digit in float:
    axial.h  + growth[0]  + growth[3]  + growth[9]
asked of constants alone, all good:
    real.h  (a > AMB_C(0.0)) && (a <= AMB_REAL_MAX)
    kalman.c  !amb_is_finite(mean[i]) ||
a loop over that check, or killed:
    kalman.c  for (int i = 0; i < n; i++) {
a start between the stops is near, and has a std:
    kalman.c  near && (std != NULL)
one position:
    equilibrium.c  (far > farthest)  if (these[i] && (amb_model_role(model, i) == AMB_POSITION))
a velocity has a position:
    equilibrium.c  (position >= 0) && these[position]
one sensor:
    equilibrium.c  these[j] || ((amb_model_role(model, j) == AMB_SHOWN)
the residual after an outage is not asked:
    equilibrium.c  bool seen = false;  seen = seen ||
as the residual, or killed:
    equilibrium.c  for (int i = 0; i < amb_states(model); i++) {
as the residual:
    envelope.c  for (int r = 0; r < amb_sensors(model); r++) {
clears what is clear, or killed:
    envelope.c  for (int j = 0; j < n; j++) {  if (j != s) {
the return value is not asked:
    envelope.c  bool some = false;  some = some ||
the return value is not asked, or killed:
    envelope.c  for (int i = 0; i < n; i++) {
both are lost, or none:
    envelope.c  (moves && lost[i])
rest is the mean elsewhere:
    envelope.c  lost[i] && (amb_model_role(model, i) == AMB_SHOWN)
all are finite, or none:
    envelope.c  (role == AMB_SHOWN) || amb_is_finite(variance[i])
within the root's own rounding:
    root.h  (AMB_C(0.5) * inverse) * (a - root * root)
the supervisor starts anew:
    kalman_step.h  !sharp || amb_is_finite(e->variance)  const bool sharp = !(
what starts it is between the stops:
    .c  AMB_WITHIN(y, far) ?
no reading or current is so large:
    kalman_prediction.h  amb_clamp(u, -AMB_REAL_ROOT
the noise of each sensor is the same everywhere:
    kalman_sensor.h  if (rise == AMB_C(0.0))
for bits that flip in memory:
    .c  finite = finite && amb_is_finite(result->variance[r])
not visited, or killed:
    .c  } else if (used && (state->doubted > 0U)) {  state->doubted--;
held within bounds they are numbers:
    .c@has_variances  r < AMB_SENSORS
one look at both, which is quicker:
    .c  (unsure | AMB_BAD_VARIANCE)) != 0U
an adaptive filter asks for the secant alone; the extended one's table is seen whole:
    table.c@bilinear  const amb_real across  s.d_iu =  s.d_x =
    table.c@locate  p.slope = ((position
    table.c@table_tangent,table_force
""")
"""Of the paper's linear filter of one axis, in float. Where the text stands more than once, or an
operator of it makes a difference, those are seen."""

CONTROL = listed("""
by 1 but where a mass is calibrated, see test_calibration.py:
    control.c  c->excess)
for bits that flip in memory:
    *  state->copy[  works_by->copy[  works_by->control  FASTEST  kept(state)  const bool there =
    *  there ? AMB_C(1.0)  state->mode > AMB_TRIPPED  state->share > AMB_C(0.0)
    *  s->doubted > c->settling  state->velocity = AMB_C(0.0)
with a sequence the supervisor says it:
    *  out->usable = true;
counted only where there were currents, and set by each such step:
    *  state->limited = false;
the envelope in the core has said so already:
    *  flags |= AMB_RESTARTED;
a step sets what acts, where it is off:
    *  for (int f = 0; f < control->law->axes; f++) {
set again as it lifts:
    *  for (int j = 0; j < control->law->pids; j++) {
one PID:
    *  j * n  j * c->axes
one axis:
    *  axis * c->states  c->spread[(f * c->pids) + j]
a machine's that is let turn:
    *  turning  turn->  where->  interpolated(  others  sum += (one[j]  left.current[
    *  at > AMB_C(0.0)
    *  int node = (int)at
    *  i < c->unbalance_control->moved
    controllers.c@largest_share,find_uncontrolled
a machine's:
    *  power *= speed
no gains follow the speed:
    controllers.c@scheduled
no reading or current is so large:
    *  (a > most) ? most : -most
the first sample is a start, without a control:
    *  / kf->set.k_ui[f]
a machine's second and third:
    *  for (int k = 0; k < 3; k++)
without a tracking time:
    *  else if (!saturated)  pid->T * pid->ki * error)
a first sample after another, of a PID that is fed by readings:
    *  state->started = false;
estimates are finite:
    *  !AMB_WITHIN(*velocity, AMB_REAL_ROOT)
the estimator has said so:
    *  status |= AMB_MISSING;
""")
"""Of the whole controller of one axis, with what is a machine's alone."""

MACHINE = listed("""
the estimate has the velocity:
    controller.c  state->started = true;
no converter of theirs is so coarse:
    kalman.c@amb_kalman_repeats  !(step > AMB_C(0.0))  (AMB_VERY_COARSE * var_y)
asked of constants and of bounded means alone, all of them good:
    real.h  (a > AMB_C(0.0)) && (a <= AMB_REAL_MAX)
    kalman.c@amb_kalman_reset  i < n; i++  !amb_is_finite(mean[i]) ||
    real.h@amb_all_within  i < n; i++  within = within &&
after an outage an innovation is within the gate, or far beyond what goes on from it:
    equilibrium.c@amb_rest_sees  bool seen = false;  i < amb_states(model)  seen = seen ||
    envelope.c@amb_envelope_hold  r < amb_sensors(model)
the greatest is found from any start:
    equilibrium.c  int most = -1;
each reading sees a position that is lost:
    equilibrium.c@amb_rest_add_followers  if (these[i] &&  these[j] = these[j] ||
the filter does not ask for the return value:
    envelope.c@amb_envelope_clamp  return !within;
    envelope.c@amb_envelope_lost  some =
clears what is clear already:
    envelope.c@set_reading  j < n  if (j != s) {
all variances are finite, or none:
    envelope.c  (role == AMB_SHOWN) ||
what is at rest is the mean elsewhere:
    envelope.c@rest_at_centre  bool shows = lost[i] &&
a start is near, and has deviations:
    kalman.c  near && (std != NULL)
the first change is smaller:
    kalman.c  kf->far[r] * kf->far[r]
no measurement is so far away:
    kalman.c  {AMB_C(2.0) * kf->far[r]
what a repeat's probability is made of, which is held to a limit:
    exponential.h  /* ln 2 in two parts */
room that no sum of rows uses up:
    covariance_loops.c  value[AMB_STATES + AMB_FORCES  row[AMB_STATES + AMB_FORCES
the sums are the same, row by row and in blocks:
    covariance_loops.c  if (n >= BLOCK)
a loop over no entries:
    loops.c@amb_model_predict_mean  model->B_u.start[i]
what lies behind is room that is written anew:
    loops.c@amb_model_update  (i + 1) < n; i += 2
what starts it is between the stops:
    .c@within_reach  AMB_WITHIN(y, far) ?
held within bounds they are numbers:
    .c@has_variances  r < AMB_SENSORS  finite = finite &&
one look at both, which is quicker:
    .c  (unsure | AMB_BAD_VARIANCE)) != 0U
a reading is a state, taken once:
    loops.c@add_row_of  cov[entry] * value  row[j - k] * value
    loops.c@amb_model_shown_variance  * model->c.value[a];
of controls past the magnets: none, or below a digit:
    covariance_loops.c  (direct > 0) &&
there is nothing in that room:
    covariance_loops.c  room.v =  room.u =
the same without a loop, which is quicker:
    covariance_loops.c  if (rows == 4)
by 1 but where a mass is calibrated, see test_calibration.py:
    control.c  c->excess)
PIDs are set again as it lifts, or were just:
    control.c  j < control->law->pids
the first sample is a start, without a control:
    control.c@amb_control_levitate  / kf->set.k_ui[f]
the supervisor says it:
    control.c  out->usable = true;
no reading or current is so large:
    control.c  (a > most) ? most : -most
for bits that flip in memory:
    control.c  works_by->copy[
    controller.c  state->copy[
    sequence.c  const bool there =
no blocks, by which nothing is filtered:
    controller.c  (pid->sections > 0) ?
what is near, or above the root, went another way before:
    kalman_prediction.h  amb_clamp(u, -AMB_REAL_ROOT
the stiffnesses are the same wherever the rotor is:
    kalman_prediction.h  amb_clamp(s, -x_max, x_max)
the noise of each sensor is the same everywhere:
    kalman_sensor.h  if (rise == AMB_C(0.0))
""")
"""Of a machine's linear filter and its controllers."""

UNROUNDED = listed("""
no sensor's readings come in steps:
    *  kf->rounding[
    kalman_sensor.h  kf->set.step[r]) > (than  const amb_real grown = before
    kalman_sensor.h  const amb_real change = y
    kalman_step.h  const bool again = !(  bool coarse = very || (interval
    kalman_step.h  as.moved  const bool measured = (status
    kalman_step.h  return amb_step_each(amb_step_plain, kf, NULL
    kalman_step.h@amb_step_rounded  const amb_real e = y  if (AMB_WITHIN(e, AMB_REAL_ROOT)
    kalman_step.h@amb_step_rounded  as = very
    kalman_step.h  if (coarse && !stays) {
""")
"""Of a machine or an axis whose readings do not come in steps."""


def lists(of_machine: bool, controlled: bool, rounded: bool) -> tuple[UndetectedFault, ...]:
    """Return what is known of an export: of a machine or an axis, a filter or a controller."""
    known = MACHINE if of_machine else CONTROL if controlled else FILTER
    return known if rounded else known + UNROUNDED


def not_run(has: ModelFeatures) -> list[UndetectedFault]:
    """Return what does not run in the self-test of a machine."""
    return [line for of, lines in NOT_RUN if of(has) for line in listed(lines)]
