#include "isolation_sweep.h"
#include "ambkit/root.h"

sweep amb_sweep_begin(const samples *of, bool crossed)
{
  const amb_isolation *iso = of->iso;
  const int n = iso->states;
  const int c = iso->columns;
  sweep w;
  w.z = of->state->work;
  w.Z = w.z + n;
  w.Y = w.Z + (n * n);
  w.g = w.Y + (c * n);
  w.M = w.g + c;
  w.rho = w.M + (c * c);
  w.y = w.rho + c;
  w.diagonal = w.y + c;
  w.t = w.diagonal + c;
  w.AZ = w.t + n;
  w.energy = AMB_C(0.0);
  w.crossed = crossed;
  amb_clear(amb_isolation_work(iso), of->state->work);
  return w;
}

/* rho of each column along a direction in a sample. */
static void regress(const amb_isolation *iso, const amb_real signal[], int direction,
                    amb_real rho[])
{
  amb_clear(iso->columns, rho);
  for (int k = 0; k < iso->terms; k++) {
    const amb_fault_term *term = &iso->term[k];
    if ((int)term->direction == direction) {
      rho[term->column] += term->weight * signal[term->signal];
    }
  }
}

/* M += a rho rho' + rho y' + y rho', g += s rho. */
static void learn(const amb_isolation *iso, sweep *w, amb_real a, amb_real s)
{
  const int c = iso->columns;
  for (int j = 0; j < c; j++) {
    const int last = w->crossed ? (c - 1) : ((j + 1 < c) ? (j + 1) : j);
    const amb_real own = w->rho[j];
    const amb_real along = (a * own) + w->y[j];
    w->g[j] += s * own;
    for (int l = j; l <= last; l++) {
      w->M[(j * c) + l] += (along * w->rho[l]) + (own * w->y[l]);
    }
  }
}

/* Back over the measurements of a sample, the last sensor first. */
static void back_over_update(const amb_isolation *iso, const amb_real *row, const amb_real signal[],
                             sweep *w)
{
  const int n = iso->states;
  const int m = iso->sensors;
  const amb_real *measured = row + amb_isolation_row(iso) - (m * (2 + n));
  for (int r = m - 1; r >= 0; r--) {
    const amb_real *H = iso->H + (r * n);
    const amb_real S = measured[(2 * r) + 1];
    if (S > AMB_C(0.0)) { /* measured */
      const amb_real *K = measured + (2 * m) + (r * n);
      w->energy += measured[2 * r] * measured[2 * r] / S;
      for (int i = 0; i < n; i++) {
        w->t[i] = dot(n, w->Z + (i * n), K);
      }
      const amb_real s = (measured[2 * r] / S) - dot(n, K, w->z);
      const amb_real weight = (AMB_C(1.0) / S) + dot(n, K, w->t);
      regress(iso, signal, iso->forces + r, w->rho);
      for (int j = 0; j < iso->columns; j++) {
        w->y[j] = -dot(n, K, w->Y + (j * n));
      }
      learn(iso, w, weight, s);
      for (int j = 0; j < iso->columns; j++) {
        const amb_real along = (weight * w->rho[j]) + w->y[j];
        for (int i = 0; i < n; i++) {
          w->Y[(j * n) + i] += (H[i] * along) - (w->t[i] * w->rho[j]);
        }
      }
      for (int i = 0; i < n; i++) {
        w->z[i] += H[i] * s;
        for (int l = 0; l < n; l++) {
          w->Z[(i * n) + l] += (weight * H[i] * H[l]) - (w->t[i] * H[l]) - (H[i] * w->t[l]);
        }
      }
    }
  }
}

/* x <- A' x; `room` is work space. */
static void carry(int n, const amb_real *A, amb_real x[], amb_real room[])
{
  for (int l = 0; l < n; l++) {
    const amb_real *column = A + l;
    amb_real sum = AMB_C(0.0);
    for (int i = 0; i < n; i++) {
      sum += column[i * n] * x[i];
    }
    room[l] = sum;
  }
  amb_copy(n, room, x);
}

/* Back over the prediction from the sample before. */
static void back_over_prediction(const amb_isolation *iso, const amb_real signal[], sweep *w)
{
  const int n = iso->states;
  for (int f = 0; f < iso->forces; f++) {
    const amb_real *b = iso->b + (f * n);
    for (int i = 0; i < n; i++) {
      w->t[i] = dot(n, w->Z + (i * n), b);
    }
    regress(iso, signal, f, w->rho);
    for (int j = 0; j < iso->columns; j++) {
      w->y[j] = dot(n, b, w->Y + (j * n));
    }
    learn(iso, w, dot(n, b, w->t), dot(n, b, w->z));
    for (int j = 0; j < iso->columns; j++) {
      for (int i = 0; i < n; i++) {
        w->Y[(j * n) + i] += w->t[i] * w->rho[j];
      }
    }
  }
  carry(n, iso->A, w->z, w->t);
  for (int j = 0; j < iso->columns; j++) {
    carry(n, iso->A, w->Y + (j * n), w->t);
  }
  for (int i = 0; i < n; i++) { /* rows of Z A, as Z is symmetric */
    carry(n, iso->A, w->Z + (i * n), w->t);
  }
  for (int i = 0; i < n; i++) {
    for (int l = 0; l < n; l++) {
      w->AZ[(i * n) + l] = w->Z[(l * n) + i];
    }
  }
  for (int i = 0; i < n; i++) {
    carry(n, iso->A, w->AZ + (i * n), w->t);
  }
  for (int i = 0; i < n; i++) { /* an asymmetry by rounding would grow with the unstable plant */
    for (int l = i; l < n; l++) {
      w->Z[(i * n) + l] = w->AZ[(i * n) + l];
      w->Z[(l * n) + i] = w->AZ[(i * n) + l];
    }
  }
}

/* Drop columns of which the elimination left only rounding. */
static void forget_rounding(const amb_isolation *iso, sweep *w)
{
  const int c = iso->columns;
  for (int j = 0; j < c; j++) {
    if (!(w->M[(j * c) + j] > (AMB_ROOT_EPSILON * w->diagonal[j]))) {
      w->g[j] = AMB_C(0.0);
      for (int l = 0; l < c; l++) {
        w->M[(j * c) + l] = AMB_C(0.0);
        w->M[(l * c) + j] = AMB_C(0.0);
      }
    }
  }
}

amb_real amb_sweep_eliminate_start(const amb_isolation *iso, sweep *w)
{
  const int n = iso->states;
  const int c = iso->columns;
  amb_real explains = AMB_C(0.0);
  for (int j = 0; j < c; j++) {
    w->diagonal[j] = w->M[(j * c) + j];
  }
  for (int k = 0; k < n; k++) {
    w->t[k] = w->Z[(k * n) + k];
  }
  for (int k = 0; k < n; k++) {
    const amb_real pivot = w->Z[(k * n) + k];
    if (pivot > (AMB_ROOT_EPSILON * w->t[k])) {
      for (int j = 0; j < c; j++) {
        w->rho[j] = w->Y[(j * n) + k];
        w->y[j] = AMB_C(0.0);
      }
      explains += (w->z[k] * w->z[k]) / pivot;
      learn(iso, w, AMB_C(-1.0) / pivot, -w->z[k] / pivot);
      for (int i = k + 1; i < n; i++) {
        const amb_real share = w->Z[(k * n) + i] / pivot;
        for (int l = k + 1; l < n; l++) {
          w->Z[(i * n) + l] -= share * w->Z[(k * n) + l];
        }
        for (int j = 0; j < c; j++) {
          w->Y[(j * n) + i] -= share * w->rho[j];
        }
        w->z[i] -= share * w->z[k];
      }
    }
  }
  forget_rounding(iso, w);
  return explains;
}

void amb_sweep_back(const samples *of, int ago, sweep *w)
{
  static const apart none = {{0}, {0}, {0}};
  const amb_real *row = row_of(of, ago);
  amb_real signal[AMB_SIGNALS];
  amb_stiffness k[AMB_FORCES];
  amb_row_signals(of, row, &none, signal, k);
  back_over_update(of->iso, row, signal, w);
  back_over_prediction(of->iso, signal, w);
}

sweep amb_sweep_to(const samples *of, int since, bool before)
{
  sweep w = amb_sweep_begin(of, true);
  for (int ago = 0; ago < since; ago++) {
    amb_sweep_back(of, ago, &w);
  }
  if (before) {
    (void)amb_sweep_eliminate_start(of->iso, &w);
  }
  return w;
}
