#include "ambkit/angle.h"
#include "ambkit/root.h"

#define TURN AMB_C(6.283185307179586)

/* Readings beyond this many standard deviations are outliers; so many in a row are accepted. */
#define GATE AMB_C(5.0)
#define OUTLIERS 3U

/* Predicted number of marks without a pulse after which pulses count as missing. */
#define MISSED AMB_C(2.5)

/* Time in which the jerk changes the acceleration by its typical size [s]. */
#define STEADY AMB_C(1.0)

/* Indices in the upper triangle. */
static const int at[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

static amb_real square(amb_real a)
{
  return a * a;
}

/* The smallest angle equal to this one modulo the distance. */
static amb_real wrapped(amb_real angle, amb_real distance)
{
  const amb_real turns = angle / distance;
  const amb_real half = (turns < AMB_C(0.0)) ? AMB_C(-0.5) : AMB_C(0.5);
  return AMB_WITHIN(turns, AMB_C(1e9)) ? (angle - (distance * (amb_real)(long)(turns + half)))
                                       : AMB_C(0.0);
}

static amb_real jerk(const amb_angle_settings *set)
{
  return square(set->acceleration) / STEADY;
}

/* Distance of the marks; an encoder's angle is known modulo a revolution. */
static amb_real distance_of(const amb_angle_settings *set)
{
  return (set->sensor == AMB_ANGLE_PULSES) ? (TURN / set->per_turn) : TURN;
}

/* Whether an angle of this variance is known to a sixth of the distance. */
static bool sure(const amb_angle_settings *set, amb_real variance)
{
  return (AMB_C(36.0) * variance) <= square(distance_of(set));
}

amb_status amb_angle_check(const amb_angle_settings *set)
{
  bool good = amb_is_positive(set->T) && amb_is_positive(set->noise) &&
              amb_is_positive(set->acceleration) && amb_is_positive(set->max_speed);
  good = good && (set->per_turn >= AMB_C(1.0)) && amb_is_finite(set->per_turn);
  const amb_real others[3] = {set->latency, set->latency_error, set->gain_error};
  for (int i = 0; i < 3; i++) {
    good = good && (others[i] >= AMB_C(0.0)) && amb_is_finite(others[i]);
  }
  return good ? AMB_OK : AMB_BAD_PARAMETER;
}

/* Start with an unknown angle, and with this speed and its variance. */
static void begin(const amb_angle_settings *set, amb_angle_state *s, amb_real speed,
                  amb_real variance)
{
  for (int i = 0; i < 6; i++) {
    s->cov[i] = AMB_C(0.0);
  }
  s->mean[0] = wrapped(s->mean[0], TURN);
  s->mean[1] = speed;
  s->restarted = true;
  s->mean[2] = AMB_C(0.0);
  s->cov[0] = square(TURN);
  s->cov[3] = variance;
  s->cov[5] = square(AMB_C(3.0) * set->acceleration);
  s->outliers = 0U;
}

void amb_angle_reset(const amb_angle_settings *set, amb_angle_state *state)
{
  state->mean[0] = AMB_C(0.0);
  begin(set, state, AMB_C(0.0), square(set->max_speed));
  state->since = AMB_C(0.0);
  state->moved = AMB_C(0.0);
  state->marked = false;
  state->backwards = set->backwards;
  state->predicted = square(set->max_speed);
  state->followed = false;
  state->waits = true;
}

/* Time update over t [s]. */
static void predict(const amb_angle_settings *set, amb_angle_state *s, amb_real t)
{
  amb_real *P = s->cov;
  const amb_real half = (t * t) / AMB_C(2.0);
  const amb_real q = jerk(set);
  s->mean[0] += (t * s->mean[1]) + (half * s->mean[2]);
  s->mean[1] += t * s->mean[2];
  /* P = Phi P Phi' with Phi = [1 t t^2/2; 0 1 t; 0 0 1], plus process noise by the jerk. */
  const amb_real a_w = P[1] + (t * P[3]) + (half * P[4]);
  const amb_real a_a = P[2] + (t * P[4]) + (half * P[5]);
  const amb_real w_w = P[3] + (t * P[4]);
  const amb_real w_a = P[4] + (t * P[5]);
  P[0] += (t * P[1]) + (half * P[2]) + (t * a_w) + (half * a_a);
  P[1] = a_w + (t * a_a);
  P[2] = a_a;
  P[3] = w_w + (t * w_a);
  P[4] = w_a;
  P[0] += (q * square(half) * t) / AMB_C(5.0);
  P[1] += (q * square(half)) / AMB_C(2.0);
  P[2] += (q * half * t) / AMB_C(3.0);
  P[3] += (q * half * t) * (AMB_C(2.0) / AMB_C(3.0));
  P[4] += q * half;
  P[5] += q * t;
}

/* Variance of the predicted H x, and P H'. */
static amb_real innovation_terms(const amb_angle_state *s, const amb_real H[3], amb_real PH[3])
{
  amb_real S = AMB_C(0.0);
  for (int i = 0; i < 3; i++) {
    PH[i] = (s->cov[at[i][0]] * H[0]) + (s->cov[at[i][1]] * H[1]) + (s->cov[at[i][2]] * H[2]);
  }
  for (int i = 0; i < 3; i++) {
    S += H[i] * PH[i];
  }
  return S;
}

/* Update with an innovation of noise variance R, in Joseph's form, which stays positive. */
static void correct(amb_angle_state *s, const amb_real H[3], const amb_real PH[3], amb_real S,
                    amb_real R, amb_real innovation)
{
  amb_real K[3];
  amb_real left[3][3]; /* (I - K H) P */
  amb_real P[6];
  for (int i = 0; i < 3; i++) {
    K[i] = PH[i] / (S + R);
    s->mean[i] += K[i] * innovation;
  }
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) {
      left[i][j] = s->cov[at[i][j]] - (K[i] * PH[j]);
    }
  }
  for (int i = 0; i < 3; i++) {
    const amb_real rest = (left[i][0] * H[0]) + (left[i][1] * H[1]) + (left[i][2] * H[2]);
    for (int j = i; j < 3; j++) {
      P[at[i][j]] = left[i][j] - (rest * K[j]) + (R * (K[i] * K[j]));
    }
  }
  for (int i = 0; i < 6; i++) {
    s->cov[i] = P[i];
  }
}

/* Number of marks by which the rotor has moved between two pulses: one forward or backward, or none
 * if it reversed at a known acceleration; that of which the speed is nearest to the prediction. */
static amb_real marks_between(const amb_angle_settings *set, const amb_angle_state *s,
                              amb_real predicted, amb_real pace, amb_real drift)
{
  const amb_real forwards = amb_magnitude((pace + drift) - predicted);
  const amb_real backwards = amb_magnitude((drift - pace) - predicted);
  const bool even = !(forwards < backwards) && !(backwards < forwards);
  const bool back = (!set->reverses || even) ? s->backwards : (backwards < forwards);
  const amb_real least = amb_at_most(forwards, backwards);
  const bool reversed = set->reverses && (square(s->mean[2]) > (AMB_C(4.0) * s->cov[5])) &&
                        (amb_magnitude(drift - predicted) < least);
  return reversed ? AMB_C(0.0) : (back ? AMB_C(-1.0) : AMB_C(1.0));
}

/* A pulse `age` ago while the angle is unknown: it determines the angle, and the time since the
 * previous pulse the speed. */
static void acquire(const amb_angle_settings *set, amb_angle_state *s, amb_real age, amb_real R,
                    amb_real innovation)
{
  amb_real *P = s->cov;
  const amb_real between = s->since - age;
  const amb_real predicted = s->mean[1] - (age * s->mean[2]);
  s->mean[0] += innovation - (age * (s->mean[1] - ((age / AMB_C(2.0)) * s->mean[2])));
  s->mean[1] = predicted;
  P[0] = R;
  P[1] = AMB_C(0.0);
  P[2] = AMB_C(0.0);
  if (s->marked && (set->sensor == AMB_ANGLE_PULSES) && (between > AMB_C(0.0))) {
    const amb_real half = between / AMB_C(2.0);
    const amb_real pace = distance_of(set) / between;
    const amb_real drift = half * s->mean[2];
    s->restarted = true;
    s->mean[1] = (marks_between(set, s, predicted, pace, drift) * pace) + drift;
    P[1] = R / between;
    P[3] = ((AMB_C(2.0) * R) / square(between)) + (square(half) * P[5]) +
           ((jerk(set) * (square(between) * between)) / AMB_C(3.0));
    P[4] = half * P[5];
  }
  s->outliers = 0U;
  predict(set, s, age);
}

/* Whether a pulse belongs to the next mark according to the prediction. If repeatedly not, the
 * speed is wrong by a multiple of the marks' distance between two pulses. */
static bool follows(const amb_angle_settings *set, const amb_angle_state *s, amb_real age)
{
  const amb_real marks = amb_magnitude(s->moved - (age * s->mean[1])) / distance_of(set);
  return (set->sensor != AMB_ANGLE_PULSES) || !s->marked ||
         ((marks > AMB_C(0.5)) && (marks < AMB_C(1.5)));
}

/* The acceleration has changed: the marks are right, but angle and speed are off by as much as the
 * innovation `between` two pulses shows. */
static void widen(const amb_angle_settings *set, amb_angle_state *s, amb_real innovation,
                  amb_real between)
{
  s->cov[0] += square(innovation);
  s->cov[3] += square(innovation / between);
  s->cov[5] += square(AMB_C(3.0) * set->acceleration);
  s->outliers = 0U;
  s->restarted = true;
}

/* Update with an angle modulo the distance, measured `age` ago. */
static unsigned int take_angle(const amb_angle_settings *set, amb_angle_state *s, amb_real angle,
                               amb_real age)
{
  const amb_real rounding = (set->sensor == AMB_ANGLE_ENCODER)
                                ? (square(TURN / set->per_turn) / AMB_C(12.0))
                                : AMB_C(0.0);
  const amb_real within = square(square(age)) * (age / AMB_C(20.0));
  const amb_real R = square(set->noise) + rounding + (jerk(set) * within);
  const amb_real H[3] = {AMB_C(1.0), -age, (age * age) / AMB_C(2.0)};
  amb_real PH[3];
  const amb_real S = innovation_terms(s, H, PH);
  const amb_real predicted = s->mean[0] + (H[1] * s->mean[1]) + (H[2] * s->mean[2]);
  const amb_real innovation = wrapped(angle - predicted, distance_of(set));
  if (!sure(set, S)) {
    acquire(set, s, age, R, innovation);
    return 0U;
  }
  const bool near = square(innovation) <= ((GATE * GATE) * (S + R));
  const bool next = follows(set, s, age);
  const unsigned int left = (s->outliers > 0U) ? (s->outliers - 1U) : 0U;
  s->outliers = (near && next) ? left : (s->outliers + 1U);
  if (s->outliers < OUTLIERS) {
    if (near) {
      correct(s, H, PH, S, R, innovation);
    }
    return near ? 0U : AMB_ANGLE_OUTLIER;
  }
  if (next && (s->since > age) && sure(set, square(innovation))) {
    widen(set, s, innovation, s->since - age);
    const amb_real wider = innovation_terms(s, H, PH);
    correct(s, H, PH, wider, R, innovation);
    return AMB_ANGLE_RESTARTED;
  }
  begin(set, s, s->mean[1], square(set->max_speed));
  acquire(set, s, age, R, innovation);
  return AMB_ANGLE_RESTARTED;
}

static unsigned int take_speed(const amb_angle_settings *set, amb_angle_state *s, amb_real speed)
{
  const amb_real age = set->latency;
  const amb_real R = square(set->noise) + ((jerk(set) * (square(age) * age)) / AMB_C(3.0));
  const amb_real H[3] = {AMB_C(0.0), AMB_C(1.0), -age};
  amb_real PH[3];
  const amb_real S = innovation_terms(s, H, PH);
  const amb_real innovation = speed - (s->mean[1] - (age * s->mean[2]));
  if (square(innovation) <= ((GATE * GATE) * (S + R))) {
    correct(s, H, PH, S, R, innovation);
    s->outliers = 0U;
    return 0U;
  }
  s->outliers++;
  if (s->outliers < OUTLIERS) {
    return AMB_ANGLE_OUTLIER;
  }
  begin(set, s, speed, R);
  return AMB_ANGLE_RESTARTED;
}

/* Pulses are missing for longer than predicted, apart from outliers: the rotor is slower than one
 * mark in that time, or at standstill. */
static bool stays_away(const amb_angle_settings *set, const amb_angle_state *s)
{
  return (set->sensor == AMB_ANGLE_PULSES) &&
         (amb_magnitude(s->moved) > ((MISSED + (amb_real)s->outliers) * distance_of(set)));
}

static unsigned int take(const amb_angle_settings *set, amb_angle_state *s, amb_real reading)
{
  if (set->sensor == AMB_ANGLE_SPEED) {
    return take_speed(set, s, reading);
  }
  if (set->sensor == AMB_ANGLE_ENCODER) {
    return take_angle(set, s, reading, set->latency);
  }
  const amb_real age = amb_clamp(reading, AMB_C(0.0), set->T) + set->latency;
  const unsigned int flags = take_angle(set, s, AMB_C(0.0), age);
  s->since = age;
  if ((flags & AMB_ANGLE_OUTLIER) == 0U) {
    s->moved = s->mean[1] * age;
    s->marked = true;
  }
  return flags;
}

/* Whether all values are finite and the variances not negative: a bit in memory may flip. */
static bool is_sound(const amb_angle_state *s)
{
  bool sound = amb_is_finite(s->since) && amb_is_finite(s->moved);
  for (int i = 0; i < 3; i++) {
    sound = sound && amb_is_finite(s->mean[i]) && (s->cov[at[i][i]] >= AMB_C(0.0));
  }
  for (int i = 0; i < 6; i++) {
    sound = sound && amb_is_finite(s->cov[i]);
  }
  return sound;
}

unsigned int amb_angle_step(const amb_angle_settings *set, amb_angle_state *state, amb_real reading)
{
  const amb_real before = state->mean[0];
  unsigned int flags = 0U;
  predict(set, state, set->T);
  state->predicted = state->cov[3];
  state->restarted = false;
  state->since += set->T;
  state->moved += state->mean[0] - before;
  if (amb_is_finite(reading)) {
    flags = take(set, state, reading);
  }
  if (stays_away(set, state)) {
    begin(set, state, AMB_C(0.0), square(distance_of(set) / state->since));
    state->moved = AMB_C(0.0);
    state->marked = false;
    flags |= AMB_ANGLE_RESTARTED;
  }
  if (square(state->mean[1]) > (AMB_C(9.0) * state->cov[3])) { /* the direction is significant */
    state->backwards = (set->reverses || (set->sensor != AMB_ANGLE_PULSES))
                           ? (state->mean[1] < AMB_C(0.0))
                           : set->backwards;
  }
  state->mean[0] = wrapped(state->mean[0], TURN);
  if (!is_sound(state)) {
    const bool followed = state->followed;
    amb_angle_reset(set, state);
    state->followed = followed;
    flags |= AMB_ANGLE_RESTARTED;
  }
  const bool lost = (set->sensor != AMB_ANGLE_SPEED) && !sure(set, state->cov[0]);
  flags |= lost ? AMB_ANGLE_LOST : 0U;
  return flags | ((set->reverses && (set->sensor == AMB_ANGLE_PULSES)) ? AMB_ANGLE_ASSUMED : 0U);
}

amb_real amb_angle_variance(const amb_angle_settings *set, const amb_angle_state *state)
{
  return state->cov[0] + square(state->mean[1] * set->latency_error);
}

/* Variance of the speed by latency and gain errors, which no reading shows. */
static amb_real considered(const amb_angle_settings *set, const amb_angle_state *state)
{
  return square(state->mean[2] * set->latency_error) + square(state->mean[1] * set->gain_error);
}

amb_real amb_angle_speed_variance(const amb_angle_settings *set, const amb_angle_state *state)
{
  return state->cov[3] + considered(set, state);
}

/* Upper limit of an unknown speed [rad/s]: no mark has passed since the last one, or the start, but
 * for those whose pulses are late. */
static amb_real speed_limit(const amb_angle_settings *set, const amb_angle_state *state)
{
  const amb_real most = amb_root(state->cov[3]);
  const amb_real time = state->since - set->latency;
  const amb_real distance = distance_of(set);
  const bool bounded = (set->sensor == AMB_ANGLE_PULSES) && ((most * time) > distance);
  return bounded ? (distance / time) : most;
}

unsigned int amb_angle_follow(const amb_angle_settings *set, amb_angle_state *state,
                              amb_real reading, amb_rotation *rotation)
{
  rotation->acceleration = state->mean[2];
  rotation->speed = state->mean[1] + ((set->T / AMB_C(2.0)) * state->mean[2]);
  const amb_real known = state->cov[3];
  const amb_real hidden = considered(set, state);
  const unsigned int flags = amb_angle_step(set, state, reading);
  /* Synchronous states follow speed and its error; lost if the angle is uncertain by a turn. */
  const bool unknown = state->waits && ((AMB_C(36.0) * state->cov[3]) > square(set->max_speed));
  const bool lost =
      (set->sensor != AMB_ANGLE_SPEED) && ((state->cov[0] >= square(TURN)) || unknown);
  const bool afresh = state->waits && state->followed && !lost;
  /* A reading reduces the error as it reduces the variance; the part that no reading shows grows
   * with the speed. */
  const amb_real left = amb_at_most(state->cov[3] / state->predicted, AMB_C(1.0));
  const amb_real both = (left * known) + amb_root(hidden * considered(set, state));
  const amb_real variance = amb_angle_speed_variance(set, state);
  rotation->kept = (lost || afresh) ? AMB_C(0.0) : (both / (known + hidden));
  rotation->noise = amb_at_least(variance - (rotation->kept * both), AMB_C(0.0));
  rotation->change = rotation->noise + (square(AMB_C(1.0) - rotation->kept) * (known + hidden));
  rotation->process_noise = amb_at_least(state->predicted - known, AMB_C(0.0));
  rotation->prior = state->restarted ? (state->predicted + hidden) : AMB_C(0.0);
  rotation->estimate = state->mean[1];
  if (unknown) {
    const amb_real most = speed_limit(set, state);
    rotation->speed = (state->backwards ? -most : most) / AMB_C(2.0);
    rotation->noise = square(most) / AMB_C(12.0);
  }
  rotation->lost = lost;
  rotation->afresh = afresh;
  rotation->now = ((flags & AMB_ANGLE_LOST) != 0U) ? AMB_C(0.0) : state->mean[1];
  state->waits = lost || (state->waits && !state->followed);
  state->followed = true; /* the first sample has no prediction */
  return flags;
}
