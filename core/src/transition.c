#include "ambkit/transition.h"
#include "square.h"
#include <float.h>

#if DBL_MANT_DIG != 53
#error "double is not IEEE 754 binary64"
#endif

#define TERMS 20         /* 1/20! is below the rounding of a double if the terms do not grow */
#define ROUNDS 24        /* iterations for the spectral radius */
#define MOST_DECAY 708.0 /* exp(-t) is a normal number up to here */

static bool is_number(double a)
{
  return (a >= -DBL_MAX) && (a <= DBL_MAX);
}

static double magnitude_of(double a)
{
  return (a < 0.0) ? -a : a;
}

static double larger_of(double a, double b)
{
  return (a > b) ? a : b;
}

/* exp(-t), t >= 0, by the series of the remainder r of t / ln 2, and halvings; error below two
 * machine epsilons. */
static double decay_over(double t)
{
  const double held = (t < MOST_DECAY) ? t : MOST_DECAY;
  const double nearest = (held * 1.4426950408889634) + 0.5;
  const int halvings = (int)nearest;
  const double n = (double)halvings;
  const double r = ((n * 0.69314718036912382) - held) + (n * 1.9082149292705877e-10);
  double sum = 1.0;
  for (int k = 14; k > 0; k--) {
    sum = 1.0 + ((r * sum) / (double)k);
  }
  for (int k = 0; k < halvings; k++) {
    sum *= 0.5;
  }
  return sum;
}

/* R: whether state j drives state i, directly or indirectly (Warshall 1962). */
static void find_paths(int n, const double A[], double R[])
{
  for (int i = 0; i < (n * n); i++) {
    R[i] = amb_is_zero(A[i]) ? 0.0 : 1.0;
  }
  for (int k = 0; k < n; k++) {
    for (int i = 0; i < n; i++) {
      if (R[(i * n) + k] > 0.0) {
        for (int j = 0; j < n; j++) {
          R[(i * n) + j] = (R[(k * n) + j] > 0.0) ? 1.0 : R[(i * n) + j];
        }
      }
    }
  }
}

static bool in_cycle(int n, const double R[], int i, int j)
{
  return (R[(i * n) + j] > 0.0) && (R[(j * n) + i] > 0.0);
}

/* Number of states on the longest path, with all members of each cycle; `length` is workspace. */
static int longest_path(int n, const double R[], double length[])
{
  double longest = 0.0;
  bool grows = true;
  for (int i = 0; i < n; i++) {
    length[i] = 0.0;
  }
  while (grows) {
    grows = false;
    for (int i = 0; i < n; i++) {
      double before = 0.0;
      double own = 0.0;
      for (int j = 0; j < n; j++) {
        const bool same = (i == j) || in_cycle(n, R, i, j);
        own += same ? 1.0 : 0.0;
        before = (!same && (R[(i * n) + j] > 0.0)) ? larger_of(length[j], before) : before;
      }
      grows = grows || ((own + before) > length[i]);
      length[i] = own + before;
      longest = larger_of(length[i], longest);
    }
  }
  return (int)longest;
}

/* Upper bound of the spectral radius of the non-negative matrix C, independent of units: the
 * largest (C x)_i / x_i of a positive x (Collatz 1942), which the power method brings close to the
 * eigenvector. Below 1/2 its value does not matter. x and y are workspace. */
static double radius_of(int n, const double C[], double x[], double y[])
{
  double radius = DBL_MAX;
  for (int i = 0; i < n; i++) {
    x[i] = 1.0;
  }
  bool matters = true;
  for (int round = 0; (round < ROUNDS) && matters; round++) {
    double bound = 0.0;
    for (int i = 0; i < n; i++) {
      y[i] = 0.0;
      for (int j = 0; j < n; j++) {
        if (C[(i * n) + j] > 0.0) {
          y[i] += C[(i * n) + j] * x[j];
        }
      }
      bound = larger_of(y[i] / x[i], bound);
    }
    radius = (bound < radius) ? bound : radius;
    matters = radius > 0.5;
    for (int i = 0; (i < n) && matters; i++) {
      x[i] = (0.5 * x[i]) + (y[i] / radius); /* the first term keeps it positive */
    }
  }
  return radius;
}

/* A fraction of the time of a linear system. */
typedef struct fraction {
  double *A;     /* A times the fraction: its cycles have a gain of at most one half */
  int terms;     /* number of terms of its series */
  int doublings; /* number of doublings to the total time */
} fraction;

/* Chooses the fraction for A time; false if that is not finite. C: magnitudes of the couplings
 * within cycles over the total time. Workspace: n^2 + 2 n more. */
static bool choose_fraction(int n, const double A[], double time, fraction *of, double C[],
                            double work[])
{
  double *R = work;
  double *length = &work[n * n];
  bool finite = true;
  for (int i = 0; i < (n * n); i++) {
    of->A[i] = A[i] * time;
    finite = finite && is_number(of->A[i]);
  }
  find_paths(n, of->A, R);
  of->terms = TERMS + longest_path(n, R, length);
  of->doublings = 0;
  for (int i = 0; i < (n * n); i++) {
    C[i] = in_cycle(n, R, i / n, i % n) ? magnitude_of(of->A[i]) : 0.0;
  }
  double part = 1.0;
  const double radius = finite ? radius_of(n, C, length, &length[n]) : 0.0;
  bool short_enough = radius <= 0.5;
  while (!short_enough) {
    of->doublings++;
    part *= 0.5;
    short_enough = (radius * part) <= 0.5;
  }
  for (int i = 0; i < (n * n); i++) {
    of->A[i] *= part;
  }
  return finite;
}

/* Exponential over the fraction by Horner's scheme; less_one: its diagonal minus 1. */
static void sum_series(int n, const fraction *of, double Phi[], double less_one[], double next[])
{
  amb_square_identity(n, Phi);
  for (int k = of->terms; k > 0; k--) {
    amb_square_multiply(n, of->A, Phi, (double)k, next);
    for (int i = 0; i < n; i++) {
      less_one[i] = next[(i * n) + i];
      next[(i * n) + i] += 1.0;
    }
    amb_square_copy(n * n, next, Phi);
  }
}

/* Phi of twice the time. The diagonal is updated as its difference from 1; otherwise each doubling
 * would lose a bit of slow states. */
static void double_time(int n, double Phi[], double less_one[], double next[])
{
  amb_square_multiply(n, Phi, Phi, 1.0, next);
  for (int i = 0; i < n; i++) {
    double around = 0.0;
    for (int k = 0; k < n; k++) {
      around += (k == i) ? 0.0 : (Phi[(i * n) + k] * Phi[(k * n) + i]);
    }
    less_one[i] = (less_one[i] * (2.0 + less_one[i])) + around;
    next[(i * n) + i] = (less_one[i] > -0.5) ? (1.0 + less_one[i]) : next[(i * n) + i];
  }
  amb_square_copy(n * n, next, Phi);
}

/* A state outside all cycles decays at its own rate, which is exact for any time. */
static void set_decays(int n, const double A[], double time, const double C[], double Phi[])
{
  for (int i = 0; i < n; i++) {
    const double rate = A[(i * n) + i] * time;
    bool by_itself = !amb_is_zero(rate);
    for (int j = 0; j < n; j++) {
      by_itself = by_itself && ((j == i) || amb_is_zero(C[(i * n) + j]));
    }
    if (by_itself) {
      const double decay = decay_over(magnitude_of(rate));
      Phi[(i * n) + i] = (rate < 0.0) ? decay : (1.0 / decay);
    }
  }
}

bool amb_transition(int n, const double A[], double time, double Phi[], double work[])
{
  double *C = &work[n * n];
  double *next = &work[2 * n * n];
  fraction of = {work, 0, 0};
  if (!choose_fraction(n, A, time, &of, C, next)) {
    return false;
  }
  double *less_one = &work[3 * n * n];
  sum_series(n, &of, Phi, less_one, next);
  for (int k = 0; k < of.doublings; k++) {
    double_time(n, Phi, less_one, next);
  }
  set_decays(n, A, time, C, Phi);
  return true;
}

/* Covariance over the fraction, by the series of dN/dt = A N + N A' + diag(intensity). */
static void sum_noise(int n, const fraction *of, double time, const double intensity[], double N[],
                      double term[], double driven[])
{
  for (int i = 0; i < (n * n); i++) {
    term[i] = ((i / n) == (i % n)) ? (intensity[i / n] * time) : 0.0;
    N[i] = term[i];
  }
  bool changed = true;
  for (int k = 2; (k <= (2 * of->terms)) && changed; k++) {
    amb_square_multiply(n, of->A, term, (double)k, driven);
    changed = false; /* each term reaches one more state */
    for (int i = 0; i < n; i++) {
      for (int j = 0; j < n; j++) {
        const double before = N[(i * n) + j];
        term[(i * n) + j] = driven[(i * n) + j] + driven[(j * n) + i];
        N[(i * n) + j] += term[(i * n) + j];
        changed = changed || (N[(i * n) + j] < before) || (N[(i * n) + j] > before);
      }
    }
  }
}

/* N(2 t) = N(t) + Phi(t) N(t) Phi(t)'. */
static void double_noise(int n, const double Phi[], double N[], double driven[])
{
  amb_square_multiply(n, Phi, N, 1.0, driven);
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      double more = 0.0;
      for (int k = 0; k < n; k++) {
        more += driven[(i * n) + k] * Phi[(j * n) + k];
      }
      N[(i * n) + j] += more;
      N[(j * n) + i] = N[(i * n) + j];
    }
  }
}

bool amb_process_noise(int n, const double A[], double time, int count, const double intensity[],
                       double N[], double work[])
{
  const int square = n * n;
  double *term = &work[square];
  double *driven = &work[2 * square];
  double *Phi = &work[3 * square];
  double *less_one = &work[4 * square];
  fraction of = {work, 0, 0};
  if (!choose_fraction(n, A, time, &of, term, driven)) {
    return false;
  }
  double part = time;
  for (int k = 0; k < of.doublings; k++) {
    part *= 0.5;
  }
  for (int w = 0; w < count; w++) {
    sum_noise(n, &of, part, &intensity[w * n], &N[w * square], term, driven);
  }
  if (of.doublings > 0) {
    sum_series(n, &of, Phi, less_one, driven);
  }
  for (int k = 0; k < of.doublings; k++) {
    for (int w = 0; w < count; w++) {
      double_noise(n, Phi, &N[w * square], driven);
    }
    double_time(n, Phi, less_one, driven);
  }
  return true;
}
