/* The yardstick: the linear filter as an engineer would structure it by hand, for this model only.
 * No checks, no status, no statistics; zeros and symmetry of the matrices used by hand.
 *
 * Paper, eq. 7-21, with the lag of the sensor followed exactly; state [x, v, f_d, x_m], covariance
 * as its upper triangle, row by row. SI. */
#include <stddef.h>

typedef struct hand {
  double T;     /* sampling time [s] */
  double m;     /* mass of the rotor [kg] */
  double a;     /* exp(-T / T_sen): what the sensor keeps in a sample [1] */
  double b;     /* what it takes on: of the position [1] */
  double c;     /* of the velocity [s] */
  double d;     /* of a force [m/N] */
  double k_ui;  /* amplifier gain [A/V] */
  double f_0;   /* known constant force [N] */
  double var_u; /* variance of the control signal [V^2] */
  double r;     /* variance of the measurement [m^2] */
  double q[10]; /* growth of the disturbance force in a sample: covariance that it leaves */
} hand;

/* n samples: measurement y [m], control signal u [V] and stiffnesses ki [N/A], ks [N/m] that act
 * from sample k to k + 1. In and out: state x (4), covariance P (10). Out: mean (n x 4), innovation
 * (n) [m] and its variance (n) [m^2]. The first sample is only taken in, and not predicted. */
void hand_run(const hand *h, size_t n, const double *y, const double *u, const double *ki,
              const double *ks, double *x, double *P, double *mean, double *innovation,
              double *variance);

void hand_run(const hand *h, size_t n, const double *y, const double *u, const double *ki,
              const double *ks, double *x, double *P, double *mean, double *innovation,
              double *variance)
{
  const double T = h->T, half = 0.5 * h->T, Tm = T / h->m, t2 = half * Tm;
  const double a = h->a, b = h->b, c = h->c, d = h->d;
  const double *q = h->q;
  double x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3];
  double p00 = P[0], p01 = P[1], p02 = P[2], p03 = P[3], p11 = P[4], p12 = P[5], p13 = P[6],
         p22 = P[7], p23 = P[8], p33 = P[9];
  for (size_t k = 0; k < n; k++) {
    if (k > 0) {
      const double s = ks[k - 1], g = ki[k - 1] * h->k_ui, e = g * g * h->var_u;
      const double f = g * u[k - 1] + s * (x0 + half * x1) + x2 + h->f_0;
      x3 = b * x0 + c * x1 + a * x3 + d * f;
      x0 += T * x1 + t2 * f;
      x1 += Tm * f;
      /* with the force [s, s half, 1, 0] X + g u: its covariance with X, then that of the next X */
      const double w0 = s * (p00 + half * p01) + p02, w1 = s * (p01 + half * p11) + p12;
      const double w2 = s * (p02 + half * p12) + p22, w3 = s * (p03 + half * p13) + p23;
      const double m00 = p00 + T * p01 + t2 * w0, m01 = p01 + T * p11 + t2 * w1;
      const double m02 = p02 + T * p12 + t2 * w2, m03 = p03 + T * p13 + t2 * w3;
      const double m10 = p01 + Tm * w0, m11 = p11 + Tm * w1;
      const double m12 = p12 + Tm * w2, m13 = p13 + Tm * w3;
      const double m30 = (b * p00 + c * p01) + a * p03 + d * w0;
      const double m31 = (b * p01 + c * p11) + a * p13 + d * w1;
      const double m32 = (b * p02 + c * p12) + a * p23 + d * w2;
      const double m33 = (b * p03 + c * p13) + a * p33 + d * w3;
      const double z0 = s * (m00 + half * m01) + (m02 + t2 * e);
      const double z1 = s * (m10 + half * m11) + (m12 + Tm * e);
      const double z3 = s * (m30 + half * m31) + (m32 + d * e);
      p00 = (m00 + T * m01 + q[0]) + t2 * z0;
      p01 = (m01 + q[1]) + Tm * z0;
      p02 = m02 + q[2];
      p03 = (b * m00 + c * m01) + (a * m03 + q[3]) + d * z0;
      p11 = (m11 + q[4]) + Tm * z1;
      p12 = m12 + q[5];
      p13 = (b * m10 + c * m11) + (a * m13 + q[6]) + d * z1;
      p22 += q[7];
      p23 = m32 + q[8];
      p33 = (b * m30 + c * m31) + (a * m33 + q[9]) + d * z3;
    }
    const double S = p33 + h->r, inv = 1 / S, e = y[k] - x3;
    const double g0 = p03 * inv, g1 = p13 * inv, g2 = p23 * inv, g3 = p33 * inv;
    x0 += g0 * e;
    x1 += g1 * e;
    x2 += g2 * e;
    x3 += g3 * e;
    p00 -= g0 * p03;
    p01 -= g0 * p13;
    p02 -= g0 * p23;
    p03 -= g0 * p33;
    p11 -= g1 * p13;
    p12 -= g1 * p23;
    p13 -= g1 * p33;
    p22 -= g2 * p23;
    p23 -= g2 * p33;
    p33 -= g3 * p33;
    mean[4 * k] = x0;
    mean[4 * k + 1] = x1;
    mean[4 * k + 2] = x2;
    mean[4 * k + 3] = x3;
    innovation[k] = e;
    variance[k] = S;
  }
}
