#include "settings.h"
#include "ambkit/exponential.h"

/* Declared as C99 (7.1.4) permits; math.h brings extensions of compilers. */
double sqrt(double a);

static double larger_of(double a, double b)
{
  return (a > b) ? a : b;
}

static double smaller_of(double a, double b)
{
  return (a < b) ? a : b;
}

static double magnitude_of(double a)
{
  return (a < 0.0) ? -a : a;
}

static double square_of(double a)
{
  return a * a;
}

/* Time constant of the unstable pole of an axis [s]. */
static double own_time(const amb_view *of, int axis)
{
  return sqrt(of->mass[axis] / of->stiffness[axis]);
}

static double quickest(const amb_view *of)
{
  double least = own_time(of, 0);
  for (int f = 1; f < of->axes; f++) {
    least = smaller_of(own_time(of, f), least);
  }
  return least;
}

static double rounded(const amb_view *of, int sensor, double var_y)
{
  return ((of->step[sensor] * of->step[sensor]) / 12.0) + var_y;
}

/* With measurement noise R at every T, a filter of bandwidth w estimates the force with a noise of
 * R T (m w^3)^2, plus the amplifier's noise. It has this bandwidth for a random walk of the
 * resulting intensity. The bandwidth is one over the sensor's lag plus 1.5 T, as more would only
 * invert the lag and amplify noise; but at least eight times the unstable pole. The random walk is
 * limited to twice the weight in one second. */
double amb_view_intensity(const amb_view *of, int axis)
{
  double R = rounded(of, 0, of->var_y[0]) / square_of(of->K_sen[0]);
  double lag = of->lag[0];
  for (int r = 1; r < of->sensors; r++) {
    R = smaller_of(rounded(of, r, of->var_y[r]) / square_of(of->K_sen[r]), R);
    lag = smaller_of(of->lag[r], lag);
  }
  const double m = of->mass[axis];
  const double w = larger_of(1.0 / ((1.5 * of->T) + lag), 8.0 / own_time(of, axis));
  const double by_control = of->var_u[axis] * square_of(of->k_i[axis] * of->k_ui[axis]);
  const double known = (R * square_of(m * (w * w))) + by_control;
  return smaller_of(square_of(2.0 * (m * AMB_GRAVITY)), known * of->T * (w * w));
}

/* Half of the shortest time constant of the axes. */
double amb_view_dwell(const amb_view *of)
{
  double least = 0.5 * own_time(of, 0) / of->T;
  for (int f = 1; f < of->axes; f++) {
    least = smaller_of(0.5 * own_time(of, f) / of->T, least);
  }
  return larger_of(10.0, least);
}

static double cap_of(const amb_view *of, amb_role role, int k)
{
  double cap = 0.0;
  switch (role) {
  case AMB_POSITION:
    cap = of->travel[k];
    break;
  case AMB_VELOCITY:
    cap = 0.1 * (of->travel[k] / of->T);
    break;
  case AMB_LOAD:
    cap = of->mass[k] * (0.1 * (of->clearance[k] / of->T) / of->T);
    break;
  case AMB_SHOWN:
    cap = 3.0 * magnitude_of(of->K_sen[k]) * of->range[k];
    break;
  default:
    cap = 10.0 * of->current_limit[k];
    break;
  }
  return cap;
}

void amb_view_caps(const amb_view *of, const amb_view_states *states, double cap[])
{
  for (int i = 0; i < states->states; i++) {
    const int k = states->index[i];
    cap[i] = (k < 0) ? (30.0 * states->size[i]) : cap_of(of, (amb_role)states->role[i], k);
  }
}

/* Three standard deviations of a reading [m times gain]. */
static double sigma_of(const amb_view *of, int sensor, const double var_y[])
{
  return 3.0 * sqrt(var_y[sensor] + ((of->step[sensor] * of->step[sensor]) / 12.0));
}

static double start_of(const amb_view *of, amb_role role, int k, const double var_y[])
{
  double std = 0.0;
  switch (role) {
  case AMB_POSITION: {
    double sum = 0.0;
    for (int r = 0; r < of->sensors; r++) {
      const double sigma = sigma_of(of, r, var_y);
      const double spread = sqrt((sigma * sigma) + of->run_out[r]) / magnitude_of(of->K_sen[r]);
      sum += square_of(of->seen[(k * of->sensors) + r] * spread);
    }
    std = sqrt(sum + of->bent[k]);
    break;
  }
  case AMB_VELOCITY:
    std = 0.1 * of->travel[k] / quickest(of);
    break;
  case AMB_LOAD:
    std = of->mass[k] * AMB_GRAVITY;
    break;
  case AMB_SHOWN:
    std = sigma_of(of, k, var_y);
    break;
  default:
    std = of->current_limit[k];
    break;
  }
  return std;
}

void amb_view_start(const amb_view *of, const amb_view_states *states, const double var_y[],
                    double std[])
{
  for (int i = 0; i < states->states; i++) {
    const int k = states->index[i];
    std[i] = (k < 0) ? (states->vague[i] * states->size[i])
                     : start_of(of, (amb_role)states->role[i], k, var_y);
  }
}

static double value_of(const double c[5], double x)
{
  return ((((((c[0] * x) + c[1]) * x) + c[2]) * x) + c[3]) * x + c[4];
}

/* The one positive root of c[0] x^4 + ... + c[4], which is convex from there on: by Newton's steps
 * from above. */
static double root_of(const double c[5])
{
  double root = 1.0;
  while (value_of(c, root) < 0.0) {
    root *= 2.0;
  }
  double last = 2.0 * root;
  while (root < last) {
    const double slope[5] = {0.0, 4.0 * c[0], 3.0 * c[1], 2.0 * c[2], c[3]};
    last = root;
    root -= value_of(c, root) / value_of(slope, root);
  }
  return last;
}

/* -ln(a) of 0 < a < 1, by Newton's steps from below. */
static double minus_log_of(double a)
{
  double x = 0.0;
  double last = -1.0;
  while (x > last) {
    last = x;
    x += 1.0 - (a / (double)amb_exp_negative((amb_real)x));
  }
  return last;
}

/* Of s = 2/a - 1, where an average with weight a passes everything. */
#define PASSES (1.0 + 1e-8)

/* Each corner is where noise and lag have the least sum of squares. The rotor moves under steps of
 * its reference, a tenth of its clearance by the unstable pole p, and under the force of intensity
 * q, in a loop with a double pole at p. With a = 2 / (1 + s), the average of the position leaves
 * R / s of the noise, and delays a velocity u by T (s - 1) / 2, beyond the lag of the sensor; that
 * of the velocity leaves corner^2 of this noise, and delays an acceleration p u by 1 / corner more;
 * that of the force leaves (m corner)^2 of that, and q / (2 corner). */
void amb_view_corners(const amb_view *of, double var_y, double intensity, double corner[3])
{
  const double p = 1.0 / own_time(of, 0);
  const double m = of->mass[0];
  const double R = rounded(of, 0, var_y) / square_of(of->K_sen[0]);
  const double lag = of->lag[0];
  const double usual = square_of(0.1 * of->clearance[0] * p);
  const double uu = usual + (intensity / (4.0 * square_of(m) * p * p * p));
  const double half = 0.5 * of->T;
  const double for_s[5] = {0.0, half, lag - half, 0.0, -R / (of->T * uu)};
  const double s = larger_of(root_of(for_s), PASSES);
  const double b = square_of(p) * uu * s / R;
  const double for_v[5] = {1.0, 0.0, 0.0, -b * (lag + (half * (s - 1.0))), -b};
  corner[0] = minus_log_of((s - 1.0) / (s + 1.0)) / of->T;
  corner[1] = root_of(for_v);
  const double for_f[5] = {0.0, 1.0, 0.0, 0.0,
                           -intensity * s / (4.0 * R * square_of(m * corner[1]))};
  corner[2] = (intensity > 0.0) ? root_of(for_f) : p;
}
