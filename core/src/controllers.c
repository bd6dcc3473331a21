#include "ambkit/controllers.h"

static amb_real dot(int n, const amb_real a[], const amb_real x[])
{
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < n; i++) {
    sum += a[i] * x[i];
  }
  return sum;
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
                                const amb_real x[], amb_real speed, amb_real iu[])
{
  amb_status status = AMB_OK;
  const int n = c->states;
  for (int f = 0; f < c->axes; f++) {
    iu[f] = fed_back(c, f, x, speed);
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
