#include "parts_step.h"
#include "ambkit/root.h"
#include <stdint.h>

#define AMB_FINEST 4096 /* parts of a substep, in contact with a stop */

/* What changes within a step. */
typedef struct amb_point {
  amb_real x, v, x_m;
  amb_real i[2];
} amb_point;

/* What does not: plant, demanded control current [A], acceleration by all constant forces [m/s^2],
 * and the angle of rotation at the sample. */
typedef struct amb_piece {
  const amb_plant *plant;
  const amb_parts *parts;
  amb_real iu, g;
  amb_real cosine, sine;
} amb_piece;

static amb_real reach(const amb_plant *plant)
{
  return plant->parts->stiffness > 0 ? plant->parts->farthest : plant->travel;
}

/* ---- Amplifier ---- */

/* Voltage of the coil towards +x, whose control current i changes at this rate [A/s]. */
static amb_real coil_voltage(const amb_parts *parts, amb_real i, amb_real rate, amb_real x,
                             amb_real v)
{
  const amb_real gap = parts->s0 - x, L = 2 * parts->k / gap, whole = parts->i0 + i;
  return L * rate + (parts->R + L * v / gap) * whole;
}

amb_real amb_parts_rate(const amb_parts *parts, amb_real i, amb_real demanded, amb_real x,
                        amb_real v)
{
  const amb_real rate = parts->corner * (demanded - i);
  if (!(parts->voltage > 0))
    return rate;
  const amb_real u = coil_voltage(parts, i, rate, x, v);
  const amb_real over = u - amb_clamp(u, -parts->voltage, parts->voltage);
  return rate - over * (parts->s0 - x) / (2 * parts->k);
}

/* Force of the magnet alone, relative to its bias force. */
static amb_real pull(const amb_plant *plant, const amb_real i[2], amb_real x)
{
  const amb_magnet *coil = &plant->coil;
  if (plant->parts->pair && (coil->methods != NULL))
    return coil->methods->force(coil->self, i[0], x) - coil->methods->force(coil->self, -i[1], -x);
  return plant->magnet.methods->force(plant->magnet.self, (i[0] + i[1]) / 2, x);
}

/* ---- Sensor ---- */

void amb_parts_turn(amb_real angle, amb_real *cosine, amb_real *sine)
{
  const amb_real a = angle / 8, q = a * a;
  amb_real c = 1, s = 1;
  for (int n = 12; n > 0; n -= 2) {
    c = 1 - c * q / (amb_real)(n * (n - 1));
    s = 1 - s * q / (amb_real)((n + 1) * n);
  }
  s *= a;
  for (int n = 0; n < 3; n++) {
    const amb_real twice = 2 * s * c;
    c = 1 - 2 * s * s;
    s = twice;
  }
  *cosine = c;
  *sine = s;
}

amb_real amb_parts_shown(const amb_parts *parts, amb_real K_sen, amb_real x, amb_real cosine,
                         amb_real sine)
{
  amb_real sum = 0, c = 1, s = 0;
  for (int n = 0; n < parts->orders; n++) {
    const amb_real next = c * cosine - s * sine;
    s = s * cosine + c * sine;
    c = next;
    sum += parts->runout_cosine[n] * c + parts->runout_sine[n] * s;
  }
  const amb_real seen = x + sum;
  const amb_real bent = (parts->quadratic + parts->cubic * seen) * seen;
  return K_sen * (seen + seen * bent);
}

/* What the sensor settles at at this time after the sample, times its gain [m]. */
static amb_real shown(const amb_piece *piece, amb_real x, amb_real t)
{
  const amb_parts *parts = piece->parts;
  amb_real c = 1, s = 0;
  if (parts->orders > 0) {
    amb_real turned_c, turned_s;
    amb_parts_turn(parts->speed * t, &turned_c, &turned_s);
    c = piece->cosine * turned_c - piece->sine * turned_s;
    s = piece->sine * turned_c + piece->cosine * turned_s;
  }
  return amb_parts_shown(parts, piece->plant->K_sen, x, c, s);
}

amb_real amb_parts_reading(const amb_parts *parts, amb_real x_m, amb_real noise)
{
  const amb_real y = x_m + amb_noise_share(parts->rise, x_m) * noise;
  if (!(parts->step > 0))
    return y;
  const amb_real steps = y / parts->step;
  if (!(amb_magnitude(steps) < AMB_C(1e15))) /* it has no digits after the point, or is none */
    return y;
  return parts->step * (amb_real)(int64_t)(steps < 0 ? steps - AMB_C(0.5) : steps + AMB_C(0.5));
}

/* ---- Contact ---- */

amb_real amb_parts_push(const amb_parts *parts, amb_real depth, amb_real inward)
{
  if (!(parts->stiffness > 0) || !(depth > 0))
    return 0;
  const amb_real give = 1 + AMB_C(1.5) * parts->damping * inward;
  return parts->stiffness * depth * amb_root(depth) * (give > 0 ? give : 0);
}

/* Force of the stop that the rotor is in [N]. */
static amb_real contact(const amb_plant *plant, amb_real x, amb_real v)
{
  const amb_real depth = amb_magnitude(x) - plant->travel;
  const amb_real push = amb_parts_push(plant->parts, depth, x > 0 ? v : -v);
  return x > 0 ? -push : push;
}

/* Past the hard end of its way it stays. Returns true where that is touched. */
static bool stop(const amb_plant *plant, amb_point *at)
{
  const amb_real end = reach(plant);
  if (!((at->x >= end) || (at->x <= -end)))
    return false;
  at->x = amb_clamp(at->x, -end, end);
  const bool outward = at->x > 0 ? at->v > 0 : at->v < 0;
  if (outward)
    at->v = 0;
  return true;
}

/* ---- One step ---- */

/* Derivatives at this time after the sample. */
static amb_point slope(const amb_piece *piece, const amb_point *at, amb_real t)
{
  const amb_plant *plant = piece->plant;
  const amb_parts *parts = piece->parts;
  const amb_real end = reach(plant), x = amb_clamp(at->x, -end, end);
  amb_point d = {.x = at->v, .x_m = (shown(piece, x, t) - at->x_m) / plant->T_sen};
  amb_real i[2] = {piece->iu, piece->iu};
  if (parts->corner > 0) {
    i[0] = at->i[0];
    i[1] = at->i[1];
    d.i[0] = amb_parts_rate(parts, i[0], piece->iu, x, at->v);
    d.i[1] = parts->pair ? -amb_parts_rate(parts, -i[1], -piece->iu, -x, -at->v) : d.i[0];
  }
  d.v = (pull(plant, i, x) + contact(plant, x, at->v)) / plant->m + piece->g;
  return d;
}

static amb_point along(const amb_point *at, const amb_point *d, amb_real h)
{
  const amb_point there = {at->x + h * d->x,
                           at->v + h * d->v,
                           at->x_m + h * d->x_m,
                           {at->i[0] + h * d->i[0], at->i[1] + h * d->i[1]}};
  return there;
}

static amb_real weighed(amb_real d1, amb_real d2, amb_real d3, amb_real d4)
{
  return (d1 + 2 * (d2 + d3) + d4) / 6;
}

/* From t after the sample on by h. Returns true where one of the stages is in a stop. */
static bool runge_kutta(const amb_piece *piece, amb_point *at, amb_real t, amb_real h)
{
  const amb_real half = h / 2, travel = piece->plant->travel;
  const amb_point d1 = slope(piece, at, t), p2 = along(at, &d1, half);
  const amb_point d2 = slope(piece, &p2, t + half), p3 = along(at, &d2, half);
  const amb_point d3 = slope(piece, &p3, t + half), p4 = along(at, &d3, h);
  const amb_point d4 = slope(piece, &p4, t + h);
  const amb_point d = {
      weighed(d1.x, d2.x, d3.x, d4.x),
      weighed(d1.v, d2.v, d3.v, d4.v),
      weighed(d1.x_m, d2.x_m, d3.x_m, d4.x_m),
      {weighed(d1.i[0], d2.i[0], d3.i[0], d4.i[0]), weighed(d1.i[1], d2.i[1], d3.i[1], d4.i[1])}};
  const bool was = amb_magnitude(at->x) > travel;
  *at = along(at, &d, h);
  return was || (amb_magnitude(p2.x) > travel) || (amb_magnitude(p3.x) > travel) ||
         (amb_magnitude(p4.x) > travel) || (amb_magnitude(at->x) > travel);
}

/* Whether a step and its two halves come to the same, to half of the digits. */
static bool agree(const amb_piece *piece, const amb_point *from, const amb_point *one,
                  const amb_point *two, amb_real h)
{
  const amb_plant *plant = piece->plant;
  const amb_real tolerance = AMB_ROOT_EPSILON, epsilon = tolerance * tolerance;
  const amb_real forces =
      amb_magnitude(pull(plant, two->i, amb_clamp(two->x, -reach(plant), reach(plant)))) +
      amb_magnitude(contact(plant, from->x, from->v)) +
      amb_magnitude(contact(plant, two->x, two->v));
  const amb_real v = amb_magnitude(from->v) + h * (amb_magnitude(piece->g) + forces / plant->m);
  return (amb_magnitude(two->v - one->v) <= tolerance * v) &&
         (amb_magnitude(two->x - one->x) <= tolerance * h * v + 4 * epsilon * plant->travel);
}

/* A step in contact, in as many parts as it takes: halved until a part is what its halves are. The
 * force begins at the stop with the power 3/2, and there it takes small ones. */
static void refined(const amb_piece *piece, amb_point *at, amb_real t, amb_real h)
{
  int done = 0, size = AMB_FINEST;
  while (done < AMB_FINEST) {
    size = size < (AMB_FINEST - done) ? size : AMB_FINEST - done;
    const amb_real unit = h / AMB_FINEST, from = t + unit * (amb_real)done;
    const amb_real step = unit * (amb_real)size;
    amb_point one = *at, two = *at;
    (void)runge_kutta(piece, &one, from, step);
    (void)runge_kutta(piece, &two, from, step / 2);
    (void)runge_kutta(piece, &two, from + step / 2, step / 2);
    if ((size > 1) && !agree(piece, at, &one, &two, step)) {
      size /= 2;
      continue;
    }
    *at = two;
    (void)stop(piece->plant, at);
    done += size;
    size *= 2;
  }
}

/* From t after the sample on by a stretch in which the demand is held. */
static bool stretch(const amb_piece *piece, amb_point *at, amb_real t, amb_real length, int steps)
{
  const amb_real h = length / (amb_real)steps;
  bool touched = false;
  for (int n = 0; n < steps; n++) {
    const amb_real from = t + h * (amb_real)n;
    amb_point next = *at;
    const bool met = runge_kutta(piece, &next, from, h);
    if (met && (piece->parts->stiffness > 0)) {
      refined(piece, at, from, h);
      touched = true;
    } else {
      *at = next;
      touched |= stop(piece->plant, at);
    }
  }
  return touched;
}

/* ---- Between two samples ---- */

static amb_piece piece_of(const amb_plant *plant, const amb_plant_state *s, amb_real iu, amb_real g)
{
  const amb_piece piece = {plant, plant->parts, iu, g, s->cosine, s->sine};
  return piece;
}

/* To the angle at the next sample; what rounding did to its length is put right. */
static void rotate(const amb_parts *parts, amb_plant_state *s)
{
  const amb_real c = s->cosine * parts->turn_cosine - s->sine * parts->turn_sine;
  const amb_real d = s->sine * parts->turn_cosine + s->cosine * parts->turn_sine;
  const amb_real right = (3 - (c * c + d * d)) / 2;
  s->cosine = right * c;
  s->sine = right * d;
}

bool amb_parts_advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                       amb_real g)
{
  const amb_parts *parts = plant->parts;
  const amb_real rest = parts->delay_rest, end = reach(plant);
  amb_plant_state *s = state;
  for (int n = parts->delay + 1; n > 0; n--)
    s->demanded[n] = s->demanded[n - 1];
  s->demanded[0] = iu;
  amb_point at = {amb_clamp(s->x, -end, end), s->v, s->x_m, {s->i[0], s->i[1]}};
  bool touched = false;
  if (rest > 0) {
    const amb_piece before = piece_of(plant, s, s->demanded[parts->delay + 1], g);
    const int steps = (int)((amb_real)plant->substeps * rest / T) + 1;
    touched |= stretch(&before, &at, 0, rest, steps);
  }
  const amb_piece after = piece_of(plant, s, s->demanded[parts->delay], g);
  const int steps =
      rest > 0 ? (int)((amb_real)plant->substeps * (T - rest) / T) + 1 : plant->substeps;
  touched |= stretch(&after, &at, rest, T - rest, steps);
  s->x = at.x;
  s->v = at.v;
  s->x_m = at.x_m;
  s->i[0] = at.i[0];
  s->i[1] = at.i[1];
  rotate(parts, s);
  return touched;
}

void amb_parts_rates(const amb_plant *plant, const amb_plant_state *state, amb_real iu, amb_real g,
                     amb_plant_state *rates)
{
  const amb_piece piece = piece_of(plant, state, iu, g);
  const amb_point at = {state->x, state->v, state->x_m, {state->i[0], state->i[1]}};
  const amb_point d = slope(&piece, &at, 0);
  const amb_plant_state found = {.x = d.x, .v = d.v, .x_m = d.x_m, .i = {d.i[0], d.i[1]}};
  *rates = found;
}

void amb_parts_settle(const amb_plant *plant, amb_plant_state *state, amb_real iu)
{
  state->cosine = 1;
  const amb_piece piece = piece_of(plant, state, iu, 0);
  state->x_m = shown(&piece, state->x, 0);
  state->i[0] = iu;
  state->i[1] = iu;
  for (int n = 0; n < AMB_DELAY_MOST + 2; n++)
    state->demanded[n] = iu;
}

amb_acting amb_parts_acting(const amb_plant *plant, const amb_plant_state *state, amb_real iu)
{
  const amb_parts *parts = plant->parts;
  const amb_real x = state->x, v = state->v;
  if (!(parts->corner > 0)) {
    const amb_acting held = {.iu = iu, .force = amb_plant_force(plant, iu, x)};
    return held;
  }
  const amb_real *i = state->i;
  amb_acting acting = {.iu = (i[0] + i[1]) / 2, .force = pull(plant, i, x) + plant->f_0};
  if (parts->voltage > 0) {
    const amb_real rate = amb_parts_rate(parts, i[0], iu, x, v);
    acting.voltage[0] = coil_voltage(parts, i[0], rate, x, v);
    if (parts->pair) {
      const amb_real other = amb_parts_rate(parts, -i[1], -iu, -x, -v);
      acting.voltage[1] = coil_voltage(parts, -i[1], other, -x, -v);
    }
  }
  return acting;
}

amb_real amb_parts_next(const amb_parts *parts, const amb_plant_state *state, amb_real iu)
{
  if (parts->delay_rest > 0)
    return state->demanded[parts->delay];
  return parts->delay > 0 ? state->demanded[parts->delay - 1] : iu;
}
