#include "plant_stage.h"

#define AMB_FINEST 4096 /* smallest parts of a substep in contact */

/* ---- One substep ---- */

/* Hard stop: an isolated axis stays at the end of its clearance. Returns true if it is touched. */
AMB_INLINE bool stop(const amb_pattern *p, const amb_substep_constants *of, amb_real X[])
{
  bool touched = false;
  for (int k = 0; p->own && (k < p->positions); k++) {
    const amb_real end = of->plant->farthest[k];
    amb_real *v = &X[p->positions + k];
    if ((X[k] >= end) || (X[k] <= -end)) {
      X[k] = amb_clamp(X[k], -end, end);
      if (X[k] > 0 ? *v > 0 : *v < 0)
        *v = 0;
      touched = true;
    }
  }
  return touched;
}

static amb_rotor_angle turned(const amb_substep_constants *of, amb_real t)
{
  const amb_rotor_angle *at = &of->at_sample;
  amb_rotor_angle now = {at->speed + of->growth * t, at->cosine, at->sine};
  if (of->turning) {
    amb_real c, d;
    amb_parts_turn((at->speed + of->growth * t / 2) * t, &c, &d);
    now.cosine = at->cosine * c - at->sine * d;
    now.sine = at->sine * c + at->cosine * d;
  }
  return now;
}

AMB_INLINE void of_length(amb_substep_constants *of, amb_real h)
{
  of->h = h;
  of->half = h / 2;
  of->sixth = h / 6;
}

/* Substep of length h, starting t after the sample. Returns whether a stage was in a soft stop. */
static bool step(const amb_pattern *p, amb_substep_constants *of, amb_real X[], amb_real t,
                 amb_real h)
{
  bool met = false;
  of->met = &met;
  of_length(of, h);
  of->turned[0] = turned(of, t);
  of->turned[1] = turned(of, t + of->half);
  of->turned[2] = turned(of, t + h);
  if (p->states == axis_with_parts.states && p->own)
    amb_substep(&axis_with_parts, of, X);
  else
    amb_substep(p, of, X);
  return met || amb_plant_in_contact(of->plant, X);
}

/* Upper bound of the acceleration of position k. */
static amb_real strength(const amb_substep_constants *of, const amb_real X[], const amb_real F[],
                         int k)
{
  const amb_plant *plant = of->plant;
  amb_real sum = amb_magnitude(of->g[k]);
  if (plant->own)
    return sum + amb_magnitude(of->per_mass[k] * F[k]);
  for (int j = plant->B.start[k]; j < plant->B.start[k + 1]; j++)
    sum += amb_magnitude(plant->B.value[j] * F[plant->B.column[j]]);
  for (int j = plant->A.start[k]; j < plant->A.start[k + 1]; j++)
    sum += amb_magnitude(plant->A.value[j] * X[plant->A.column[j]]);
  return sum;
}

/* Whether one step and two half steps agree to half of the digits. */
static bool agree(const amb_pattern *p, const amb_substep_constants *of, const amb_real from[],
                  const amb_real one[], const amb_real two[], amb_real h)
{
  const amb_real tolerance = AMB_ROOT_EPSILON, epsilon = tolerance * tolerance;
  amb_real F1[AMB_PLANT_AXES], F2[AMB_PLANT_AXES], d[AMB_PLANT_STATES];
  amb_stage(p, of, from, 0, F1, d);
  amb_stage(p, of, two, 2, F2, d);
  for (int k = 0; k < p->positions; k++) {
    const int v = p->positions + k;
    const amb_real fast =
        amb_magnitude(from[v]) + h * (strength(of, from, F1, k) + strength(of, two, F2, k));
    const amb_real near = tolerance * h * fast + 4 * epsilon * of->plant->ring[0].travel;
    if (!(amb_magnitude(two[v] - one[v]) <= tolerance * fast) ||
        !(amb_magnitude(two[k] - one[k]) <= near))
      return false;
  }
  return true;
}

/* A substep in contact, with an adaptive step size: halved until one step agrees with its two
 * halves. The contact force begins with the power 3/2 of the penetration, which needs small steps
 * there. */
static void refined(const amb_pattern *p, amb_substep_constants *of, amb_real X[], amb_real t,
                    amb_real h)
{
  int done = 0, size = AMB_FINEST;
  while (done < AMB_FINEST) {
    size = size < (AMB_FINEST - done) ? size : AMB_FINEST - done;
    const amb_real unit = h / AMB_FINEST, from = t + unit * (amb_real)done;
    const amb_real length = unit * (amb_real)size;
    amb_real one[AMB_PLANT_STATES], two[AMB_PLANT_STATES];
    amb_copy(p->states, X, one);
    amb_copy(p->states, X, two);
    (void)step(p, of, one, from, length);
    (void)step(p, of, two, from, length / 2);
    (void)step(p, of, two, from + length / 2, length / 2);
    if ((size > 1) && !agree(p, of, X, one, two, length)) {
      size /= 2;
      continue;
    }
    amb_copy(p->states, two, X);
    (void)stop(p, of, X);
    done += size;
    size *= 2;
  }
}

/* Interval with constant demand, starting t after the sample. */
AMB_INLINE bool stretch(const amb_pattern *p, amb_substep_constants *of, amb_real X[], amb_real t,
                        amb_real length, int steps)
{
  const amb_real h = length / (amb_real)steps;
  bool touched = false;
  of_length(of, h);
  for (int n = 0; n < steps; n++) {
    if (p->plain) {
      amb_substep(p, of, X);
      touched |= stop(p, of, X);
    } else {
      const amb_real from = t + h * (amb_real)n;
      amb_real next[AMB_PLANT_STATES];
      amb_copy(p->states, X, next);
      if (step(p, of, next, from, h)) {
        refined(p, of, X, from, h);
        touched = true;
      } else {
        amb_copy(p->states, next, X);
        touched |= stop(p, of, X);
      }
    }
  }
  return touched;
}

/* ---- Between two samples ---- */

static bool needs_angle(const amb_plant *plant)
{
  bool any = plant->cosine != NULL;
  for (int r = 0; r < plant->sensors; r++)
    any = any || (plant->sensor[r].orders > 0);
  return any;
}

/* Sets the constants of a sample. */
AMB_INLINE void prepare(const amb_pattern *p, amb_substep_constants *of, const amb_plant *plant,
                        const amb_plant_state *state, amb_real T, const amb_acts *acts)
{
  of->plant = plant;
  of->acts = acts;
  of->demanded = acts->demanded;
  of->as_built = amb_plant_as_built(acts);
  for (int k = 0; k < p->positions; k++) {
    if (p->own) {
      of->g[k] = (plant->g[k] + acts->load[k]) / plant->mass[k];
      of->per_mass[k] = 1 / plant->mass[k];
    } else
      of->g[k] = plant->g[k] + amb_sparse_times(&plant->B, plant->B.value, k, acts->load);
  }
  for (int k = 0; (acts->base != NULL) && (plant->base != NULL) && (k < 3); k++)
    if (plant->base[k] >= 0)
      of->g[plant->base[k]] -= acts->base[k];
  for (int r = 0; r < p->sensors; r++)
    of->per_lag[r] = 1 / plant->lag[r];
  if (!p->plain) {
    const amb_rotor_angle now = {acts->speed, state->cosine, state->sine};
    of->at_sample = of->turned[0] = now;
    of->growth = (acts->next - acts->speed) / T;
    of->turning =
        ((acts->speed < 0) || (acts->speed > 0) || (acts->next < 0) || (acts->next > 0)) &&
        needs_angle(plant);
  }
}

/* Number of substeps in a part of a sample. */
static int steps_in(const amb_plant *plant, amb_real part, amb_real T)
{
  return part < T ? (int)((amb_real)plant->substeps * part / T) + 1 : plant->substeps;
}

/* Appends the demand to the delay line. */
static void delay_demand(const amb_plant *plant, amb_plant_state *state, const amb_real demanded[])
{
  for (int n = plant->delay + 1; n > 0; n--)
    amb_copy(plant->axes, state->demanded[n - 1], state->demanded[n]);
  amb_copy(plant->axes, demanded, state->demanded[0]);
}

/* Advances the angle to the next sample, and normalises the vector against rounding. */
static void rotate(const amb_substep_constants *of, amb_plant_state *state, amb_real T)
{
  const amb_rotor_angle then = turned(of, T);
  const amb_real right = (3 - (then.cosine * then.cosine + then.sine * then.sine)) / 2;
  state->cosine = right * then.cosine;
  state->sine = right * then.sine;
}

AMB_INLINE bool advance(const amb_pattern *p, const amb_plant *plant, amb_plant_state *state,
                        amb_real T, const amb_acts *acts)
{
  const amb_real rest = plant->delay_rest;
  amb_real X[AMB_PLANT_STATES];
  amb_substep_constants of;
  bool touched = false;
  prepare(p, &of, plant, state, T, acts);
  amb_copy(p->states, state->X, X);
  for (int k = 0; p->own && (k < p->positions); k++)
    X[k] = amb_plant_within(plant, k, X[k]);
  if ((plant->delay > 0) || (rest > 0)) {
    delay_demand(plant, state, acts->demanded);
    if (rest > 0) {
      of.demanded = state->demanded[plant->delay + 1];
      touched = stretch(p, &of, X, 0, rest, steps_in(plant, rest, T));
    }
    of.demanded = state->demanded[plant->delay];
  }
  touched |= stretch(p, &of, X, rest, T - rest, steps_in(plant, T - rest, T));
  amb_copy(p->states, X, state->X);
  if (!p->plain)
    rotate(&of, state, T);
  return touched;
}

static bool has_closed_law(const amb_plant *plant)
{
  return (plant->magnet[0].methods == &amb_law_magnet) &&
         ((const amb_law *)plant->magnet[0].self)->two_sided;
}

static bool is_axis(const amb_plant *plant)
{
  return plant->own && (plant->axes == 1);
}

static amb_pattern pattern_of(const amb_plant *plant)
{
  const amb_pattern p = {plant->positions, plant->axes, plant->sensors, plant->states,
                         plant->own,       false,       false};
  return p;
}

bool amb_plant_is_plain_axis(const amb_plant *plant)
{
  return is_axis(plant) && plant->plain && (plant->delay == 0) && !(plant->delay_rest > 0) &&
         has_closed_law(plant);
}

bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T,
                       const amb_acts *acts)
{
  if (is_axis(plant) && plant->plain)
    return amb_plant_as_built(acts) && has_closed_law(plant)
               ? advance(&closed_axis, plant, state, T, acts)
               : advance(&plain_axis, plant, state, T, acts);
  if (is_axis(plant) && (plant->states == axis_with_parts.states))
    return advance(&axis_with_parts, plant, state, T, acts);
  const amb_pattern any = pattern_of(plant);
  return advance(&any, plant, state, T, acts);
}

void amb_plant_rates(const amb_plant *plant, const amb_plant_state *state, const amb_acts *acts,
                     amb_real rates[])
{
  const amb_pattern p = pattern_of(plant);
  const int q = p.positions;
  amb_real X[AMB_PLANT_STATES], F[AMB_PLANT_AXES];
  amb_substep_constants of;
  bool met = false;
  prepare(&p, &of, plant, state, 1, acts);
  of.met = &met;
  amb_copy(p.states, state->X, X);
  for (int k = 0; p.own && (k < q); k++)
    X[k] = amb_plant_within(plant, k, X[k]);
  amb_stage(&p, &of, X, 0, F, rates);
  for (int k = 0; k < q; k++) {
    rates[k] = X[q + k];
    rates[q + k] = amb_driven(&p, &of, of.g[k] + rates[q + k], 1, F, k);
  }
}
