/* The yardstick: the linear filter as an engineer would structure it by hand, for this model only.
 * No checks, no status, no statistics; zeros and symmetry of the matrices used by hand.
 *
 * Paper, eq. 7-21; state [x, v, f_d, x_m], covariance as its upper triangle, row by row. SI. */
#include <stddef.h>

typedef struct hand {
  double T;     /* sampling time [s] */
  double m;     /* mass of the rotor [kg] */
  double a;     /* exp(-T / T_sen): what the sensor keeps in a sample [1] */
  double b;     /* K_sen (1 - a) [1] */
  double k_ui;  /* amplifier gain [A/V] */
  double f_0;   /* known constant force [N] */
  double var_u; /* variance of the control signal [V^2] */
  double var_d; /* growth of the disturbance force's variance in a sample [N^2] */
  double r;     /* variance of the measurement [m^2] */
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
  const double T = h->T, Tm = T / h->m, c = 0.5 * T * T / h->m, a = h->a, b = h->b;
  double x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3];
  double p00 = P[0], p01 = P[1], p02 = P[2], p03 = P[3], p11 = P[4], p12 = P[5], p13 = P[6],
         p22 = P[7], p23 = P[8], p33 = P[9];
  for (size_t k = 0; k < n; k++) {
    if (k > 0) {
      const double s = ks[k - 1], g = ki[k - 1] * h->k_ui;
      const double f = g * u[k - 1] + s * x0 + x2 + h->f_0;
      const double new3 = b * x0 + a * x3;
      x0 += T * x1 + c * f;
      x1 += Tm * f;
      x3 = new3;
      /* rows of A P: A = [a00 T c 0; a10 1 Tm 0; 0 0 1 0; b 0 0 a] */
      const double a00 = 1 + c * s, a10 = Tm * s;
      const double m00 = a00 * p00 + T * p01 + c * p02, m01 = a00 * p01 + T * p11 + c * p12;
      const double m02 = a00 * p02 + T * p12 + c * p22, m03 = a00 * p03 + T * p13 + c * p23;
      const double m10 = a10 * p00 + p01 + Tm * p02, m11 = a10 * p01 + p11 + Tm * p12;
      const double m12 = a10 * p02 + p12 + Tm * p22, m13 = a10 * p03 + p13 + Tm * p23;
      const double m30 = b * p00 + a * p03, m33 = b * p03 + a * p33;
      const double q = g * g * h->var_u;
      p00 = m00 * a00 + m01 * T + m02 * c + c * c * q;
      p01 = m00 * a10 + m01 + m02 * Tm + c * Tm * q;
      p11 = m10 * a10 + m11 + m12 * Tm + Tm * Tm * q;
      p03 = m00 * b + m03 * a;
      p13 = m10 * b + m13 * a;
      p23 = b * p02 + a * p23;
      p02 = m02;
      p12 = m12;
      p22 += h->var_d;
      p33 = m30 * b + m33 * a;
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
