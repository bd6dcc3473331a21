/* The settings of a filter that nobody states: what follows from its machine. Python and the
 * workbench take them from here. In double in every build; matrices are row by row.
 */
#ifndef AMBKIT_SIM_SETTINGS_H
#define AMBKIT_SIM_SETTINGS_H

#include "ambkit/role.h"

#define AMB_GRAVITY 9.81 /* [m/s^2] */

/* A machine as its filters see it. */
typedef struct amb_view {
  double T; /* sampling time [s] */
  int axes;
  const double *mass;          /* [axes] that each moves [kg] */
  const double *clearance;     /* [axes] [m] */
  const double *stiffness;     /* [axes] magnitude of k_s in the middle [N/m] */
  const double *k_i;           /* [axes] in the middle [N/A] */
  const double *k_ui;          /* [axes] gains of the amplifiers [A/V] */
  const double *current_limit; /* [axes] [A] */
  const double *var_u;         /* [axes] of their noise [V^2] */
  int sensors;
  const double *K_sen;   /* [sensors] gains [1] */
  const double *lag;     /* [sensors] [s] */
  const double *step;    /* [sensors] quantisation [m]; 0: none */
  const double *var_y;   /* [sensors] of their noise [m^2] */
  const double *range;   /* [sensors] what the stops leave to each [m] */
  const double *run_out; /* [sensors] variance of what the filter estimates of it [m^2] */
  int positions;         /* of the rigid rotor */
  const double *travel;  /* [positions] what the stops leave to each [m] or [rad] */
  const double *seen;    /* positions x sensors: the rotor that explains the readings best */
  const double *bent;    /* [positions] variance by bending, as it is seen so */
} amb_view;

/* The states of its model. */
typedef struct amb_view_states {
  int states;
  const unsigned char *role; /* [states] amb_role */
  const int *index;          /* [states] which position, axis or sensor it is of; below 0: none */
  const double *size;        /* [states] typical size of one that is of none ... */
  const double *vague;       /* [states] ... and in so many of them where it is at the start */
} amb_view_states;

/* Process noise intensity of an axis [N^2/s]. */
double amb_view_intensity(const amb_view *of, int axis);

/* For how many samples a rotor at rest stays within a very coarse step of its sensor. */
double amb_view_dwell(const amb_view *of);

/* The most that each state can be (ambkit/envelope.h). */
void amb_view_caps(const amb_view *of, const amb_view_states *states, double cap[]);

/* Standard deviations at the start, with these variances of the measurements [sensors] [m^2]. */
void amb_view_start(const amb_view *of, const amb_view_states *states, const double var_y[],
                    double std[]);

/* Corner frequencies of the low-pass filters of an axis [rad/s]: of position, velocity and force,
 * with this variance of the measurement [m^2] and intensity of the force [N^2/s]. */
void amb_view_corners(const amb_view *of, double var_y, double intensity, double corner[3]);

#endif
