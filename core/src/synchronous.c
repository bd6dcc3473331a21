#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

#include "ambkit/root.h"
#include "synchronous.h"

/* Synchronous states, pairs of a cosine and a sine component, of a rotor whose angle is estimated:
 * the effects of the speed error, and restarts after a lost angle. */

/* Scales a state's dependence on all previous states; 0: it is independent of them. */
static void scale_row(const amb_model *model, amb_real numbers[], int row, amb_real share)
{
  for (int k = model->L.start[row]; k < (int)model->L.start[row + 1]; k++) {
    numbers[k] *= share;
  }
}

/* Rotates a pair by the error of the angle: the column of the error, state `at`, becomes the
 * derivative, and the mean is rotated back by what that column adds. */
static void rotate_pair(const amb_model *model, amb_real numbers[], amb_real mean[], int i,
                        amb_real angle_by_error, int at)
{
  amb_real *by_error[2] = {amb_transition_entry(model, numbers, i, at),
                           amb_transition_entry(model, numbers, i + 1, at)};
  if ((by_error[0] == NULL) || (by_error[1] == NULL)) {
    return;
  }
  *by_error[0] = AMB_C(0.0);
  *by_error[1] = AMB_C(0.0);
  const amb_real x = amb_sparse_times(&model->L, numbers, i, mean);
  const amb_real y = amb_sparse_times(&model->L, numbers, i + 1, mean);
  const amb_real back = angle_by_error * mean[at];
  const amb_real rotated = mean[i] + (back * mean[i + 1]);
  mean[i + 1] -= back * mean[i];
  mean[i] = rotated;
  *by_error[0] = -angle_by_error * y;
  *by_error[1] = angle_by_error * x;
}

/* Half the relative change of speed^2 + |growth|, to which unbalance forces are proportional, per
 * rad/s. */
static amb_real share_of(amb_real speed, amb_real growth)
{
  const amb_real total = (speed * speed) + amb_magnitude(growth);
  return (total > AMB_C(0.0)) ? (speed / total) : AMB_C(0.0);
}

/* Change of state i within a sample per rad/s of speed error, as pair forces depend on the speed.
 */
static amb_real force_by_error(const amb_model *model, const amb_speed_error *error,
                               amb_real numbers[], const amb_real mean[], int i, amb_real share)
{
  amb_real sum = AMB_C(0.0);
  for (int k = 0; k < error->pairs; k++) {
    const amb_synchronous *pair = &error->pair[k];
    for (int j = pair->state; (j < (pair->state + 2)) && (pair->power > AMB_C(0.0)); j++) {
      const amb_real *value = amb_transition_entry(model, numbers, i, j);
      sum += (value == NULL) ? AMB_C(0.0) : (pair->power * (*value * mean[j]));
    }
  }
  return share * sum;
}

/* The same for all positions and velocities; what the column of the error adds is subtracted from
 * their means. */
static void force_states(const amb_model *model, const amb_speed_error *error, amb_real numbers[],
                         amb_real mean[], amb_real share)
{
  const int at = error->state;
  for (int i = 0; i < amb_states(model); i++) {
    const amb_role role = amb_model_role(model, i);
    amb_real *by_error = amb_transition_entry(model, numbers, i, at);
    if ((by_error != NULL) && ((role == AMB_POSITION) || (role == AMB_VELOCITY))) {
      *by_error = force_by_error(model, error, numbers, mean, i, share);
      mean[i] -= *by_error * mean[at];
    }
  }
}

/* Additional process noise of an uncertain pair if the speed error changes: its effect on other
 * states changes in proportion, a second-order term without an entry in L. The variance of the pair
 * stays below the initial one. */
static amb_real by_change(const amb_synchronous *pair, const amb_kalman *kf,
                          const amb_kalman_state *state, const amb_rotation *rotation,
                          amb_real start)
{
  const int n = amb_states(&kf->model);
  const int i = pair->state;
  const amb_real both = state->cov[amb_entry(n, i, i)] + state->cov[amb_entry(n, i + 1, i + 1)];
  const amb_real mean = both / AMB_C(2.0);
  const bool known = !rotation->lost && !rotation->afresh;
  const amb_real share =
      known ? (pair->power * share_of(rotation->speed, rotation->acceleration)) : AMB_C(0.0);
  const amb_real most = amb_at_least(start - mean, AMB_C(0.0));
  return amb_at_most(((share * share) * rotation->change) * mean, most);
}

/* A pair over a sample: it rotates by the error in addition to the known angle, unless the angle is
 * lost. If that was never known, neither is the speed, of this variance: the pair is a Markov
 * process of constant size, whose bandwidth is the standard deviation of the speed. */
static void follow(const amb_synchronous *pair, const amb_speed_error *error, amb_kalman *kf,
                   amb_kalman_state *state, amb_real numbers[], const amb_rotation *rotation,
                   bool forgets, amb_real variance)
{
  amb_real *mean = state->mean;
  const amb_real std = error->std[pair->state];
  const amb_real by_error = rotation->lost ? AMB_C(0.0) : (pair->order * kf->set.T);
  kf->set.var_d[pair->noise] = pair->usual + by_change(pair, kf, state, rotation, std * std);
  rotate_pair(&kf->model, numbers, mean, pair->state, by_error, error->state);
  if (rotation->afresh || forgets) {
    const amb_real angle = pair->order * (amb_root(variance) * kf->set.T);
    const amb_real kept = rotation->afresh ? AMB_C(0.0) : (AMB_C(1.0) / (AMB_C(1.0) + angle));
    scale_row(&kf->model, numbers, pair->state, kept);
    scale_row(&kf->model, numbers, pair->state + 1, kept);
    if (forgets) {
      kf->set.var_d[pair->noise] = (AMB_C(1.0) - (kept * kept)) * (std * std);
    }
  }
}

/* Revolutions after which the size of a pair is known. */
#define SIZED AMB_C(8.0)

/* Square of twice the amplitude of a pair over its vague initial variance [1], with `share` of the
 * present variance. Twice, because the runout of several sensors may be in phase. */
static amb_real relative_size(const amb_speed_error *error, const amb_kalman_state *state, int n,
                              int k, amb_real share)
{
  const int at = error->pair[k].state;
  const amb_real vague = error->pair[k].vague;
  amb_real sum = AMB_C(0.0);
  for (int i = at; i < (at + 2); i++) {
    sum += (state->mean[i] * state->mean[i]) + (share * state->cov[amb_entry(n, i, i)]);
  }
  return (AMB_C(2.0) * sum) / (vague * vague);
}

/* Its maxima: [0] of pairs that do not depend on the speed, as runout, [1] of those that do, as
 * unbalance. */
static void size_of(const amb_model *model, const amb_speed_error *error,
                    const amb_kalman_state *state, amb_real size[2])
{
  size[0] = AMB_C(0.0);
  size[1] = AMB_C(0.0);
  for (int k = 0; k < error->pairs; k++) {
    const int which = (error->pair[k].power > AMB_C(0.0)) ? 1 : 0;
    const amb_real one = relative_size(error, state, amb_states(model), k, AMB_C(1.0));
    size[which] = amb_at_least(amb_at_most(one, AMB_C(1.0)), size[which]);
  }
}

/* Initial standard deviation of a state, of a pair the vague one. */
static amb_real vague_std(const amb_speed_error *error, int i)
{
  amb_real result = error->std[i];
  for (int k = 0; k < error->pairs; k++) {
    const int at = error->pair[k].state;
    result = ((i == at) || (i == (at + 1))) ? error->pair[k].vague : result;
  }
  return result;
}

/* Upper limit of the size of pairs that are dropped. */
#define DROPPED AMB_C(100.0)

/* Adds the uncertainty of the restarted pairs to all states that were estimated without them, also
 * bending and sensor states: otherwise these would separate unbalance from runout, which is
 * impossible at a constant speed. Scaled by the size of the pairs if it is known; velocities by
 * that of unbalance, and by displacements times the speed. Otherwise displacements are off by the
 * pairs that are dropped, too, which grow large in the wrong direction. */
static void widen(const amb_model *model, const amb_speed_error *error,
                  const amb_kalman_state *state, const amb_real size[2], amb_real square_speed,
                  amb_real process_noise[])
{
  const int n = amb_states(model);
  amb_real dropped = AMB_C(0.0);
  for (int k = 0; k < error->pairs; k++) {
    const amb_real one = relative_size(error, state, n, k, AMB_C(0.0));
    dropped = amb_at_least(amb_at_most(one, DROPPED), dropped);
  }
  const amb_real most = amb_at_least(size[0], size[1]);
  const bool sized = (most > AMB_C(0.0)) && (most < AMB_C(1.0));
  int next = amb_first(model, AMB_VELOCITY);
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    const bool displaced = (role == AMB_POSITION) || (role == AMB_SHOWN);
    const amb_real unsized = displaced ? amb_at_least(dropped, AMB_C(1.0)) : AMB_C(1.0);
    const amb_real share = sized ? ((role == AMB_VELOCITY) ? size[1] : most) : unsized;
    const amb_real std = sized ? vague_std(error, i) : error->std[i];
    const amb_real variance = share * (std * std);
    if ((role != AMB_KNOWN) && (i != error->state)) {
      process_noise[amb_entry(n, i, i)] += variance;
    }
    if ((role == AMB_POSITION) && (next >= 0) && (next < n)) {
      process_noise[amb_entry(n, next, next)] += square_speed * variance;
      next++;
    }
  }
}

/* Whether the phase of any pair is known to half a radian. */
static bool is_phase_known(const amb_model *model, const amb_speed_error *error,
                           const amb_kalman_state *state)
{
  const int n = amb_states(model);
  bool known = false;
  for (int k = 0; k < error->pairs; k++) {
    const int i = error->pair[k].state;
    const amb_real x = state->mean[i];
    const amb_real y = state->mean[i + 1];
    const amb_real across = ((x * x) * state->cov[amb_entry(n, i + 1, i + 1)]) -
                            (((AMB_C(2.0) * x) * y) * state->cov[amb_entry(n, i, i + 1)]) +
                            ((y * y) * state->cov[amb_entry(n, i, i)]);
    const amb_real square = (x * x) + (y * y);
    known = known || ((AMB_C(4.0) * across) < (square * square));
  }
  return known;
}

/* Whether the angle filter follows its readings: it knows the angle, and has not restarted. */
static bool follows_readings(const amb_rotation *rotation)
{
  return !rotation->lost && !rotation->afresh && !(rotation->prior > AMB_C(0.0));
}

/* Whether the pairs continue without the angle sensor, where it loses the angle or restarts: their
 * phase was known after some revolutions, and has been since; for at most a radian of drift by the
 * uncertain speed, because beyond it the linearisation claims what is not known. */
static bool continues(const amb_speed_error *error, const amb_kalman *kf,
                      const amb_kalman_state *state, const amb_rotation *rotation,
                      amb_direction *direction)
{
  const bool follows = follows_readings(rotation);
  const bool settled = direction->passed > (SIZED * AMB_REVOLUTION);
  const int at = error->state;
  const amb_real variance = state->cov[amb_entry(amb_states(&kf->model), at, at)];
  if (follows && settled && (amb_magnitude(rotation->now) > AMB_C(0.0))) {
    size_of(&kf->model, error, state, direction->size);
  }
  direction->drift = follows ? AMB_C(0.0) : (direction->drift + (amb_root(variance) * kf->set.T));
  const bool coherent = direction->drift < AMB_C(1.0);
  direction->held = follows
                        ? (direction->held || settled)
                        : (direction->held && coherent && is_phase_known(&kf->model, error, state));
  return direction->held && !follows;
}

/* Twice the log-likelihood ratio that reverses the direction at a restart. */
#define REVERSED AMB_C(18.0)

/* The speed error where the angle filter does not follow its readings. While the angle is lost, the
 * speed that readings of the position gave last is kept: extrapolating the angle filter's speed
 * would rotate the pairs of a rotor at rest. They gave the speed `seen` with information J; at a
 * restart it is fused with the new speed of the angle filter, in the direction that fits better.
 * Returns the error for which the transition gives the fused one.
 */
static amb_real continued(const amb_kalman_state *state, int n, int at, amb_real T, bool watched,
                          amb_rotation *by, amb_direction *direction)
{
  const amb_real P = state->cov[amb_entry(n, at, at)];
  const amb_real error = state->mean[at];
  const amb_real V = by->noise + ((by->kept * by->kept) * (by->prior - by->process_noise));
  if (!(by->prior > AMB_C(0.0))) {
    by->kept = AMB_C(1.0);
    by->noise = by->process_noise;
    by->change = by->process_noise;
    return error;
  }
  const amb_real J = (AMB_C(1.0) / (P + by->process_noise)) - (AMB_C(1.0) / by->prior);
  if (!(J > AMB_C(0.0))) {
    return error;
  }
  const amb_real predicted = by->speed + ((T / AMB_C(2.0)) * by->acceleration);
  const amb_real seen = predicted + (error / ((P + by->process_noise) * J));
  const amb_real ratio = (AMB_C(-4.0) * seen) * (by->estimate / (V + (AMB_C(1.0) / J)));
  if (watched && (ratio > REVERSED)) {
    by->estimate = -by->estimate;
    by->now = -by->now;
    direction->mirrored = !direction->mirrored;
    amb_direction_restart(direction);
  }
  const amb_real fused = AMB_C(1.0) / (J + (AMB_C(1.0) / V));
  by->kept = fused * J;
  by->noise = amb_at_least(fused - ((by->kept * by->kept) * P), AMB_C(0.0));
  by->change = fused;
  return seen - by->estimate;
}

amb_real amb_rotate(const amb_turning *nodes, const amb_speed_error *error, amb_kalman *kf,
                    amb_kalman_state *state, amb_real numbers[], amb_direction *direction,
                    const amb_rotation *rotation)
{
  const int at = error->state;
  const bool watched = (at >= 0) && error->reverses && (error->pairs > 0);
  const bool paired = (at >= 0) && (error->pairs > 0);
  const bool continuing = paired && continues(error, kf, state, rotation, direction);
  amb_rotation by = *rotation;
  by.lost = by.lost && !continuing;
  by.afresh = by.afresh && !continuing;
  if (at >= 0) {
    const bool begins = by.lost || by.afresh || !(direction->passed >= AMB_C(0.0));
    direction->passed =
        begins ? AMB_C(0.0) : (direction->passed + (amb_magnitude(by.speed) * kf->set.T));
  }
  if (watched) {
    by = amb_directed(error, kf, state, direction, &by);
  }
  const amb_real known = ((at < 0) || by.afresh) ? AMB_C(0.0) : state->mean[at];
  const amb_real speed = by.speed + known;
  const bool speed_continues = paired && !by.afresh && !follows_readings(rotation);
  const amb_real next = speed_continues ? continued(state, amb_states(&kf->model), at, kf->set.T,
                                                    watched, &by, direction)
                                        : known;
  const bool forgets =
      by.lost && !(amb_at_least(direction->size[0], direction->size[1]) > AMB_C(0.0));
  amb_turning_to(nodes, speed, by.acceleration, numbers);
  amb_real *own = (at < 0) ? NULL : amb_transition_entry(&kf->model, numbers, at, at);
  if (own != NULL) {
    *own = by.kept;
    kf->set.var_d[error->noise] = by.noise;
    state->mean[at] = next;
    force_states(&kf->model, error, numbers, state->mean,
                 by.lost ? AMB_C(0.0) : share_of(speed, by.acceleration));
    for (int k = 0; k < error->pairs; k++) {
      follow(&error->pair[k], error, kf, state, numbers, &by, forgets, rotation->noise);
    }
    if (watched) {
      amb_direction_predict(error, kf, numbers, state->mean, speed, direction);
    }
  }
  amb_model_growth(&kf->model, kf->set.var_d, kf->growth);
  if (by.afresh && (error->std != NULL)) {
    widen(&kf->model, error, state, direction->size, (by.now * by.now) + by.noise, kf->growth);
  }
  const bool sized = amb_at_least(direction->size[0], direction->size[1]) > AMB_C(0.0);
  return (sized && (direction->passed < AMB_REVOLUTION)) ? AMB_C(0.0) : by.now;
}

#endif
