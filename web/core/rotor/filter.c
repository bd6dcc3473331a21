/* The filter of a rotor: its model is made of physical parameters by ambkit/rebuild.h. The page
 * writes pattern, plan and settings as numbers one after the other, in the order of `read_filter`.
 */
#include "rotor.h"

#define NUMBERS 8192
#define SLOTS 4096
#define PLAN 1024

static double input[4 * NUMBERS];
static unsigned short starts[2048], columns[NUMBERS];
static unsigned char roles[AMB_STATES];
static double numbers[NUMBERS], parameters[64], low[64], high[64], constant[PLAN], room[SLOTS * 16];
static unsigned char operation[SLOTS], use[PLAN];
static unsigned short left[SLOTS], right[SLOTS], row[PLAN], column[PLAN], value[PLAN], k_i[WIDE];
static unsigned short intensity[AMB_NOISES * AMB_STATES];
static unsigned int from[NUMBERS];
static amb_rebuild plan;
static amb_model model;
static amb_kalman_settings set;
static amb_stiffness constants[WIDE];
static amb_magnet known[WIDE];
static amb_law laws[WIDE];
static double std[AMB_STATES], start[AMB_STATES];

static amb_kalman kf;
static amb_kalman_state state;
static amb_estimator estimator;
static double mean[MOST * AMB_STATES / 2], innovation[MOST * WIDE], variance[MOST * WIDE];
static double stiffness[2][MOST * WIDE];
static unsigned short status[MOST], health[MOST * WIDE];

static const double *next;

static void take(int n, double to[])
{
  amb_copy(n, next, to);
  next += n;
}

static int count(void)
{
  return (int)*next++;
}

static void take_places(int n, unsigned short to[])
{
  for (int i = 0; i < n; i++)
    to[i] = (unsigned short)count();
}

/* Rows of a matrix: where they start, and their columns; its numbers come from the plan. */
static int take_pattern(int rows, int *s, int *c, amb_sparse *to)
{
  take_places(rows + 1, &starts[*s]);
  const int entries = (int)starts[*s + rows];
  take_places(entries, &columns[*c]);
  to->start = &starts[*s];
  to->column = &columns[*c];
  *s += rows + 1;
  *c += entries;
  return entries;
}

static void take_model(void)
{
  int s = 0, c = 0, at = 0;
  const int n = model.states = count(), p = model.forces = count();
  model.controls = count();
  model.sensors = count();
  model.noises = count();
  const amb_real **values[] = {&model.L.value, &model.b.value, &model.B_u.value, &model.h.value,
                               &model.d.value, &model.c.value, &model.N.value,   &model.rest.value};
  amb_sparse *parts[] = {&model.L, &model.b, &model.B_u, &model.h,
                         &model.d, &model.c, &model.N,   &model.rest};
  const int rows[] = {n, n, n, p, p, model.sensors, model.noises, n};
  for (int k = 0; k < 8; k++) {
    const int entries = take_pattern(rows[k], &s, &c, parts[k]);
    *values[k] = &numbers[at];
    at += entries;
    if (k == 3) { /* e and r stand behind h */
      model.e = &numbers[at];
      model.r = &numbers[at + entries];
      at += 2 * entries;
    }
  }
  for (int i = 0; i < n; i++)
    roles[i] = (unsigned char)count();
  model.role = roles;
}

static void take_plan(void)
{
  plan = (amb_rebuild){.low = low,
                       .high = high,
                       .constant = constant,
                       .operation = operation,
                       .left = left,
                       .right = right,
                       .value = value,
                       .k_i = k_i,
                       .intensity = intensity,
                       .from = from};
  plan.parameters = count();
  take(plan.parameters, low);
  take(plan.parameters, high);
  plan.constants = count();
  take(plan.constants, constant);
  plan.operations = count();
  for (int i = 0; i < plan.operations; i++)
    operation[i] = (unsigned char)count();
  take_places(plan.operations, left);
  take_places(plan.operations, right);
  plan.plan = (amb_plan){.T = *next++,
                         .states = model.states,
                         .forces = model.forces,
                         .controls = model.controls,
                         .noises = model.noises,
                         .row = row,
                         .column = column,
                         .use = use};
  plan.plan.terms = count();
  take_places(plan.plan.terms, row);
  take_places(plan.plan.terms, column);
  for (int i = 0; i < plan.plan.terms; i++)
    use[i] = (unsigned char)count();
  take_places(plan.plan.terms, value);
  take_places(model.forces, k_i);
  take_places(model.noises * model.states, intensity);
  plan.numbers = count();
  for (int i = 0; i < plan.numbers; i++)
    from[i] = (unsigned int)count();
}

static void take_settings(void)
{
  const int n = model.states, p = model.forces, m = model.sensors;
  set = (amb_kalman_settings){.T = plan.plan.T, .gate = 8.0, .frozen_limit = 10U};
  set.outlier_limit = 3U;
  take(m, set.K_sen);
  take(m, set.lag);
  take(m, set.travel);
  take(p, set.k_ui);
  take(p, set.iu_min);
  take(p, set.iu_max);
  take(p, set.f_0);
  take(p, set.x_max);
  take(n, set.cap);
  take(p, set.var_u);
  take(model.noises, set.var_d);
  take(m, set.var_y);
  take(m, set.step);
  set.dwell = *next++;
  take(n, std);
  take(n, start);
}

EXPORT(filter_input) double *filter_input(void)
{
  return input;
}

EXPORT(filter_parameters) double *filter_parameters(void)
{
  return parameters;
}

EXPORT(read_filter) void read_filter(void)
{
  next = input;
  take_model();
  take_plan();
  take_settings();
}

EXPORT(filter_history) void *filter_history(int which)
{
  void *const all[] = {mean, innovation, variance, status};
  return all[which];
}

const amb_estimator *rotor_filter(bool extended, double k, const amb_law magnets[])
{
  if (!amb_rebuild_numbers(&plan, parameters, numbers, room) ||
      (amb_kalman_init(&kf, &model, &set) != AMB_OK))
    return NULL;
  for (int f = 0; f < model.forces; f++) {
    laws[f] = magnets[f];
    laws[f].k *= k;
    constants[f] = amb_law_magnet.tangent(&laws[f], 0, 0);
    known[f] = extended ? (amb_magnet){&amb_law_magnet, &laws[f]}
                        : (amb_magnet){&amb_constant_magnet, &constants[f]};
  }
  estimator = (amb_estimator){.methods = extended ? &amb_extended_methods : &amb_kalman_methods,
                              .kf = &kf,
                              .magnet = known};
  return estimator.methods->reset(&estimator, &state, start, std) == AMB_OK ? &estimator : NULL;
}

void *rotor_filter_state(void)
{
  return &state;
}

amb_kalman_history rotor_filter_history(void)
{
  const amb_kalman_history to = {.mean = mean,
                                 .innovation = innovation,
                                 .variance = variance,
                                 .k_i = stiffness[0],
                                 .k_s = stiffness[1],
                                 .status = status,
                                 .health = health};
  return to;
}
