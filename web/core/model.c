/* A filter's model from physical parameters, by ambkit/rebuild.h. The page writes pattern, plan and
 * states as consecutive numbers, in the order of `read_model`. */
#include "bench.h"

#define NUMBERS 16384
#define SLOTS 8192
#define PLAN 2048

void axial_constants(const double p[], double to[]); /* axial.c */

static double input[4 * NUMBERS];
static unsigned short starts[4096], columns[NUMBERS], past[8 * WIDE];
static unsigned char roles[AMB_STATES];
static double numbers[NUMBERS], low[64], high[64], constant[PLAN], room[SLOTS * 16];
static unsigned char operation[SLOTS], use[PLAN];
static unsigned short left[SLOTS], right[SLOTS], row[PLAN], column[PLAN], value[PLAN], k_i[WIDE];
static unsigned short intensity[AMB_NOISES * AMB_STATES];
static unsigned int from[NUMBERS];
static amb_late late[WIDE];
static int named[NUMBERS], names; /* indices of the numbers that are constants of the paper's axis
                                   */
static int indices[AMB_STATES];
static double sizes[AMB_STATES], vague[AMB_STATES], others[AMB_NOISES];
static amb_rebuild plan;
static bench_model made;

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

/* Pattern of a matrix: row starts and columns; its numbers come from the plan. */
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
  amb_model *model = &made.model;
  const int n = model->states = count(), p = model->forces = count();
  model->controls = count();
  model->sensors = count();
  model->noises = count();
  const amb_real **values[] = {&model->L.value, &model->b.value,   &model->B_u.value,
                               &model->h.value, &model->d.value,   &model->c.value,
                               &model->N.value, &model->rest.value};
  amb_sparse *parts[] = {&model->L, &model->b, &model->B_u, &model->h,
                         &model->d, &model->c, &model->N,   &model->rest};
  const int rows[] = {n, n, n, p, p, model->sensors, model->noises, n};
  for (int k = 0; k < 8; k++) {
    const int entries = take_pattern(rows[k], &s, &c, parts[k]);
    *values[k] = &numbers[at];
    at += entries;
    if (k == 3) { /* e and r follow h */
      model->e = &numbers[at];
      model->r = &numbers[at + entries];
      at += 2 * entries;
    }
  }
  for (int i = 0; i < n; i++)
    roles[i] = (unsigned char)count();
  model->role = roles;
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
  plan.plan = (amb_plan){.states = made.model.states,
                         .forces = made.model.forces,
                         .controls = made.model.controls,
                         .noises = made.model.noises,
                         .row = row,
                         .column = column,
                         .use = use};
  plan.plan.terms = count();
  take_places(plan.plan.terms, row);
  take_places(plan.plan.terms, column);
  for (int i = 0; i < plan.plan.terms; i++)
    use[i] = (unsigned char)count();
  take_places(plan.plan.terms, value);
  take_places(made.model.forces, k_i);
  take_places(made.model.noises * made.model.states, intensity);
  plan.numbers = count();
  for (int i = 0; i < plan.numbers; i++)
    from[i] = (unsigned int)count();
}

static void take_lates(void)
{
  unsigned short *at = past;
  plan.plan.lates = count();
  plan.plan.late = late;
  for (int k = 0; k < plan.plan.lates; k++) {
    late[k].control = count();
    late[k].count = count();
    late[k].past = at;
    take_places(late[k].count, at);
    at += late[k].count;
    late[k].share = *next++;
  }
}

static void take_states(void)
{
  const int n = made.model.states;
  for (int i = 0; i < n; i++)
    indices[i] = count();
  take(n, sizes);
  take(n, vague);
  made.states = (amb_view_states){n, roles, indices, sizes, vague};
  made.loads = count();
  take(made.model.noises - made.loads, others);
  made.others = others;
  made.gate = *next++;
  made.frozen_limit = (unsigned int)count();
  made.outlier_limit = (unsigned int)count();
  names = count();
  for (int i = 0; i < names; i++)
    named[i] = count();
}

EXPORT(model_input) double *model_input(void)
{
  return input;
}

EXPORT(read_model) void read_model(void)
{
  next = input;
  take_model();
  take_plan();
  take_lates();
  take_states();
}

/* Share of the sample after which a late demand acts, the same for all controls. */
EXPORT(set_share) void set_share(double share)
{
  for (int k = 0; k < plan.plan.lates; k++)
    late[k].share = share;
}

const bench_model *bench_model_of(double T, const double parameters[])
{
  double constants[32];
  plan.plan.T = T;
  if (!amb_rebuild_numbers(&plan, parameters, numbers, room))
    return NULL;
  if (names > 0)
    axial_constants(parameters, constants);
  for (int i = 0; i < names; i++)
    if (named[i] > 0)
      numbers[i] = constants[named[i] - 1];
  return &made;
}
