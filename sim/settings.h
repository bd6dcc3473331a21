/* Default settings of a filter, derived from its machine, for Python and the workbench. In double
 * in every build; matrices are row by row. */
#ifndef AMBKIT_SIM_SETTINGS_H
#define AMBKIT_SIM_SETTINGS_H

#include "ambkit/role.h"

#define AMB_GRAVITY 9.81 /* [m/s^2] */

/* A machine as seen by its filters. */
typedef struct amb_view {
  double T; /* sampling time [s] */
  int axes;
  const double *mass;          /* [axes] moving mass [kg] */
  const double *clearance;     /* [axes] [m] */
  const double *stiffness;     /* [axes] magnitude of k_s at the centre [N/m] */
  const double *k_i;           /* [axes] at the centre [N/A] */
  const double *k_ui;          /* [axes] amplifier gains [A/V] */
  const double *current_limit; /* [axes] [A] */
  const double *var_u;         /* [axes] control noise [V^2] */
  int sensors;
  const double *K_sen;   /* [sensors] gains [1] */
  const double *lag;     /* [sensors] [s] */
  const double *step;    /* [sensors] quantisation [m]; 0: none */
  const double *var_y;   /* [sensors] noise [m^2] */
  const double *range;   /* [sensors] clearance [m] */
  const double *run_out; /* [sensors] variance of the runout that the filter estimates [m^2] */
  int positions;         /* of the rigid rotor */
  const double *travel;  /* [positions] clearance [m] or [rad] */
  const double *seen;    /* positions x sensors: least-squares positions from the readings */
  const double *bent;    /* [positions] variance of these by bending */
} amb_view;

/* States of its model. */
typedef struct amb_view_states {
  int states;
  const unsigned char *role; /* [states] amb_role */
  const int *index;          /* [states] number of its position, axis or sensor; below 0: none */
  const double *size;        /* [states] typical size of a state without one ... */
  const double *vague;       /* [states] ... and its initial standard deviation in these sizes */
} amb_view_states;

/* Process noise intensity of an axis [N^2/s]. */
double amb_view_intensity(const amb_view *of, int axis);

/* Number of samples for which a rotor at rest stays within a very coarse step of its sensor. */
double amb_view_dwell(const amb_view *of);

/* Maximum of each state (ambkit/envelope.h). */
void amb_view_caps(const amb_view *of, const amb_view_states *states, double cap[]);

/* Initial standard deviations, for these variances of the measurements [sensors] [m^2]. */
void amb_view_start(const amb_view *of, const amb_view_states *states, const double var_y[],
                    double std[]);

/* Corner frequencies of the low-pass filters of an axis [rad/s]: position, velocity and force, for
 * this variance of the measurement [m^2] and intensity of the force [N^2/s]. */
void amb_view_corners(const amb_view *of, double var_y, double intensity, double corner[3]);

#endif
