/* The interactive rotor on several bearings. */
#include "rotor.h"

static bench_filter under_hand;
static amb_loop_state state;
static amb_loop moves;
static double k, push[WIDE], seen[5 * WIDE + BENDS + 2];

EXPORT(live_push) double *live_push(void)
{
  return push;
}

/* Apply the description; `anew`: from the centre, else from the present state. */
EXPORT(rotor_live_set) void rotor_live_set(int kind, int anew)
{
  bench_filter *filter = &under_hand;
  moves = rotor_with_filter(filter, rotor.loop.feedback_estimate ? kind : -1);
  if (anew != 0) {
    rotor_settle(&state);
    k = 0;
  } else if (moves.estimator != NULL)
    rotor_start_filter(filter, state.y, rotor.held);
}

/* Advances by so many samples at a speed [rad/s]. Returns displacements along the axes, velocities,
 * currents and forces of each, cosine and sine of the angle, and the positions. */
EXPORT(rotor_live_step) double *rotor_live_step(int n, double turns, int off)
{
  const size_t p = (size_t)rotor.loop.plant.axes, m = (size_t)rotor.loop.plant.sensors;
  const double none[WIDE] = {0}, speeds[2] = {turns, turns}, noise = rotor.noisy ? 1 : 0;
  double w_u[WIDE], w_y[WIDE];
  const amb_loop_sample sample = {.r = none,
                                  .load = push,
                                  .noise_u = w_u,
                                  .noise_y = w_y,
                                  .speed = speeds,
                                  .scale = 1,
                                  .off = off != 0,
                                  .fly = true};
  for (int i = 0; i < n; i++) {
    for (size_t c = 0; c < p; c++)
      bench_draw(rotor.seed, AMB_NOISE_STREAMS * (uint32_t)c, (size_t)k, 1, 1,
                 noise * rotor.var_u[c], &w_u[c]);
    for (size_t c = 0; c < m; c++)
      bench_draw(rotor.seed, AMB_NOISE_STREAMS * (uint32_t)c + 1U, (size_t)k, 1, 1,
                 noise * rotor.var_y[c], &w_y[c]);
    (void)amb_loop_step(&moves, &state, &under_hand.state, &sample);
    if (off != 0)
      for (size_t c = 0; c < p; c++)
        amb_pid_reset(&state.pid[c], rotor.integral[c]);
    k += 1;
  }
  const double *at = state.plant.X;
  for (int f = 0; f < rotor.loop.plant.axes; f++) {
    seen[f] = amb_plant_along(&rotor.loop.plant, f, at);
    seen[p + (size_t)f] = amb_plant_along(&rotor.loop.plant, f, at + rotor.loop.plant.positions);
    seen[2 * p + (size_t)f] = state.acting[f].iu;
    seen[3 * p + (size_t)f] = state.acting[f].force + rotor.bias[f];
  }
  seen[4 * p] = state.plant.cosine;
  seen[4 * p + 1] = state.plant.sine;
  amb_copy(rotor.loop.plant.positions, at, &seen[4 * p + 2]);
  return seen;
}
