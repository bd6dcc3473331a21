#include "ambkit/controllers.h"

static amb_real dot(int n, const amb_real a[], const amb_real x[])
{
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < n; i++) {
    sum += a[i] * x[i];
  }
  return sum;
}

/* Position of a speed among the nodes: the preceding node and the fraction of the interval. */
typedef struct amb_between {
  int node;
  amb_real share;
} amb_between;

/* whether the speed is beyond the first node */
static bool find(const amb_unbalance_control *turn, amb_real speed, amb_between *where)
{
  const int last = turn->nodes - 1;
  const amb_real at = amb_clamp((speed - turn->first) / turn->step, AMB_C(0.0), (amb_real)last);
  const int node = (int)at;
  where->node = (node < last) ? node : (last - 1);
  where->share = at - (amb_real)where->node;
  return at > AMB_C(0.0);
}

/* Row of a table at a speed, multiplied by the unbalance u. */
static amb_real interpolated(const amb_unbalance_control *turn, const amb_between *where,
                             const amb_real table[], int row, int rows, const amb_real u[])
{
  const amb_real *one = &table[((where->node * rows) + row) * turn->width];
  const amb_real *next = &one[rows * turn->width];
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < turn->width; j++) {
    sum += (one[j] + (where->share * (next[j] - one[j]))) * u[j];
  }
  return amb_is_finite(sum) ? sum : AMB_C(0.0);
}

/* The motion that is not controlled: its share in the first states, and its currents. */
typedef struct amb_uncontrolled {
  amb_real motion[AMB_UNBALANCE_STATES];
  amb_real current[AMB_UNBALANCE_AXES];
} amb_uncontrolled;

/* Square of the largest share of a clearance or a current limit over one revolution. The motion a
 * quarter revolution later is its velocity over the speed; the current is that of the unbalance
 * rotated by a quarter. */
static amb_real largest_share(const amb_controllers *c, const amb_between *where,
                              const amb_real u[], amb_real speed, const amb_uncontrolled *left)
{
  const amb_unbalance_control *turn = c->unbalance_control;
  const int half = turn->moved / 2;
  amb_real across[AMB_UNBALANCE_WIDTH];
  amb_real most = AMB_C(0.0);
  for (int j = 0; (j + 1) < turn->width; j += 2) {
    across[j] = -u[j + 1];
    across[j + 1] = u[j];
  }
  for (int f = 0; f < c->axes; f++) {
    const amb_real *reach = &turn->reach[f * half];
    const amb_real s = dot(half, reach, left->motion);
    const amb_real v = dot(half, reach, &left->motion[half]) / speed;
    const amb_real i = turn->ampere[f] * left->current[f];
    const amb_real e =
        turn->ampere[f] * interpolated(turn, where, turn->current, f, c->axes, across);
    const amb_real far = (s * s) + (v * v);
    const amb_real much = (i * i) + (e * e);
    const bool known = amb_is_finite(far) && amb_is_finite(much);
    most = amb_at_least(known ? amb_at_least(far, much) : AMB_C(1.0), most);
  }
  return most;
}

/* The motion that is not controlled, at a speed and an estimate x. */
static void find_uncontrolled(const amb_controllers *c, const amb_between *where, amb_real speed,
                              const amb_real x[], amb_uncontrolled *left)
{
  const amb_unbalance_control *turn = c->unbalance_control;
  const amb_real *u = &x[turn->from];
  for (int i = 0; i < turn->moved; i++) {
    left->motion[i] = interpolated(turn, where, turn->motion, i, turn->moved, u);
  }
  for (int f = 0; f < c->axes; f++) {
    left->current[f] = interpolated(turn, where, turn->current, f, c->axes, u);
  }
  const amb_real upper = AMB_UNBALANCE_NONE * AMB_UNBALANCE_NONE;
  const amb_real lower = AMB_UNBALANCE_FULL * AMB_UNBALANCE_FULL;
  const amb_real most = largest_share(c, where, u, speed, left);
  const amb_real share = amb_clamp((upper - most) / (upper - lower), AMB_C(0.0), AMB_C(1.0));
  for (int i = 0; i < turn->moved; i++) {
    left->motion[i] *= share;
  }
  for (int f = 0; f < c->axes; f++) {
    left->current[f] *= share;
  }
}

/* Feedback of the states to the current of an axis, by powers 0, 1 and 2 of the speed. */
static amb_real fed_back(const amb_controllers *c, int axis, const amb_real x[], amb_real speed)
{
  amb_real sum = AMB_C(0.0);
  amb_real power = AMB_C(1.0);
  for (int k = 0; k < 3; k++) {
    if (c->gain[k] != NULL) {
      sum += power * dot(c->states, &c->gain[k][axis * c->states], x);
    }
    power *= speed;
  }
  return amb_is_finite(sum) ? sum : AMB_C(0.0);
}

/* A PID with its gains at a speed. */
static amb_pid scheduled(const amb_controllers *c, int pid, amb_real speed)
{
  const amb_gain_schedule *schedule = c->schedule;
  const amb_real at = amb_magnitude(speed);
  amb_pid result = c->pid[pid];
  int node = 0;
  while ((node < (schedule->nodes - 1)) && (at >= schedule->speed[node + 1])) {
    node++;
  }
  const amb_real *one = &schedule->gain[((node * c->pids) + pid) * AMB_SCHEDULED];
  const amb_real *next = one;
  amb_real share = AMB_C(0.0);
  if ((node < (schedule->nodes - 1)) && (at > schedule->speed[node])) {
    const amb_real from = schedule->speed[node];
    next = &one[c->pids * AMB_SCHEDULED];
    share = (at - from) / (schedule->speed[node + 1] - from);
  }
  result.kp = one[0] + (share * (next[0] - one[0]));
  result.ki = one[1] + (share * (next[1] - one[1]));
  result.kd = one[2] + (share * (next[2] - one[2]));
  result.T_f = one[3] + (share * (next[3] - one[3]));
  return result;
}

amb_status amb_controllers_step(const amb_controllers *c, amb_pid_state pid[], const amb_real r[],
                                const amb_real state[], amb_real speed, amb_real iu[])
{
  amb_status status = AMB_OK;
  const int n = c->states;
  const amb_real *x = state;
  amb_real others[AMB_UNBALANCE_STATES];
  amb_uncontrolled left;
  amb_between where;
  const bool turning = (c->unbalance_control != NULL) && find(c->unbalance_control, speed, &where);
  if (turning) {
    find_uncontrolled(c, &where, speed, state, &left);
    amb_copy(c->states, state, others);
    for (int i = 0; i < c->unbalance_control->moved; i++) {
      others[i] -= left.motion[i];
    }
    x = others;
  }
  for (int f = 0; f < c->axes; f++) {
    iu[f] = fed_back(c, f, x, speed);
    if (turning) {
      iu[f] += left.current[f];
    }
  }
  for (int j = 0; j < c->pids; j++) {
    const amb_real reference =
        (c->reference != NULL) ? dot(c->axes, &c->reference[j * c->axes], r) : r[j];
    const amb_real at = dot(n, &c->position[j * n], x);
    amb_real e;
    amb_real v = AMB_C(0.0);
    if (c->velocity != NULL) {
      v = dot(n, &c->velocity[j * n], x);
    }
    const amb_real *known = (c->velocity != NULL) ? &v : NULL;
    amb_pid now;
    const amb_pid *law = &c->pid[j];
    if (c->schedule != NULL) {
      now = scheduled(c, j, speed);
      law = &now;
    }
    status |= amb_pid_step(law, &pid[j], reference, at, known, &e);
    for (int f = 0; f < c->axes; f++) {
      iu[f] += c->spread[(f * c->pids) + j] * e;
    }
  }
  for (int f = 0; f < c->axes; f++) {
    const amb_real demanded = iu[f];
    iu[f] = amb_clamp(demanded, c->iu_min[f], c->iu_max[f]);
    if ((iu[f] < demanded) || (iu[f] > demanded)) {
      status |= AMB_SATURATED;
    }
  }
  return status;
}
