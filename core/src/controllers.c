#include "ambkit/controllers.h"

static amb_real dot(int n, const amb_real a[], const amb_real x[])
{
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < n; i++) {
    sum += a[i] * x[i];
  }
  return sum;
}

/* Where a speed is among the nodes: the one before, and the share of the way to the next. */
typedef struct amb_between {
  int node;
  amb_real share;
} amb_between;

/* Whether it is past the first node. */
static bool find(const amb_let_turn *turn, amb_real speed, amb_between *where)
{
  const int last = turn->nodes - 1;
  const amb_real at = amb_clamp((speed - turn->first) / turn->step, AMB_C(0.0), (amb_real)last);
  const int node = (int)at;
  where->node = (node < last) ? node : (last - 1);
  where->share = at - (amb_real)where->node;
  return at > AMB_C(0.0);
}

/* A row of a table of so many rows at a speed, times the unbalance. */
static amb_real turned(const amb_let_turn *turn, const amb_between *where, const amb_real table[],
                       int row, int rows, const amb_real x[])
{
  const amb_real *one = &table[((where->node * rows) + row) * turn->width];
  const amb_real *next = &one[rows * turn->width];
  amb_real sum = AMB_C(0.0);
  for (int j = 0; j < turn->width; j++) {
    sum += (one[j] + (where->share * (next[j] - one[j]))) * x[turn->from + j];
  }
  return amb_is_finite(sum) ? sum : AMB_C(0.0);
}

/* What the states add to the current of an axis, by no, one and two powers of the speed. */
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

amb_status amb_controllers_step(const amb_controllers *c, amb_pid_state pid[], const amb_real r[],
                                const amb_real state[], amb_real speed, amb_real iu[])
{
  amb_status status = AMB_OK;
  const int n = c->states;
  const amb_real *x = state;
  amb_real others[AMB_LET_TURN_STATES];
  amb_between where;
  const bool turning = (c->let_turn != NULL) && find(c->let_turn, speed, &where);
  if (turning) {
    const amb_let_turn *turn = c->let_turn;
    for (int i = 0; i < n; i++) {
      others[i] = state[i];
    }
    for (int i = 0; i < turn->moved; i++) {
      others[i] -= turned(turn, &where, turn->motion, i, turn->moved, state);
    }
    x = others;
  }
  for (int f = 0; f < c->axes; f++) {
    iu[f] = fed_back(c, f, x, speed);
    if (turning) {
      iu[f] += turned(c->let_turn, &where, c->let_turn->current, f, c->axes, state);
    }
  }
  for (int j = 0; j < c->pids; j++) {
    const amb_real wanted =
        (c->reference != NULL) ? dot(c->axes, &c->reference[j * c->axes], r) : r[j];
    const amb_real at = dot(n, &c->position[j * n], x);
    amb_real e;
    amb_real v = AMB_C(0.0);
    if (c->velocity != NULL) {
      v = dot(n, &c->velocity[j * n], x);
    }
    if (c->turning != NULL) {
      v += speed * dot(n, &c->turning[j * n], x);
    }
    const amb_real *known = (c->velocity != NULL) ? &v : NULL;
    status |= amb_pid_step(&c->pid[j], &pid[j], wanted, at, known, &e);
    for (int f = 0; f < c->axes; f++) {
      iu[f] += c->spread[(f * c->pids) + j] * e;
    }
  }
  for (int f = 0; f < c->axes; f++) {
    const amb_real asked = iu[f];
    iu[f] = amb_clamp(asked, c->iu_min[f], c->iu_max[f]);
    if ((iu[f] < asked) || (iu[f] > asked)) {
      status |= AMB_SATURATED;
    }
  }
  return status;
}
