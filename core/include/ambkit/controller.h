/* PID with set-point weight, derivative filter and anti-windup, followed by second-order sections.
 * Input in metres, output a commanded control current. */
#ifndef AMBKIT_CONTROLLER_H
#define AMBKIT_CONTROLLER_H

#include "ambkit/real.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

/* Maximum number of sections of a PID. */
#ifndef AMB_SECTIONS
#define AMB_SECTIONS 8
#endif

/* Coefficients of a section: b0, b1, b2, a1, a2, with out = b0 in + b1 in' + b2 in'' - a1 out' -
 * a2 out''. */
#define AMB_SECTION 5

typedef struct amb_pid {
  amb_real T;      /* sampling time [s] */
  amb_real kp;     /* [A/m] */
  amb_real ki;     /* [A/(m s)] */
  amb_real kd;     /* [A s/m], on the measured value: no kick from a step of the reference */
  amb_real T_f;    /* derivative filter, time constant [s]; 0: none */
  amb_real T_t;    /* anti-windup by back-calculation, tracking time [s]; 0: the integrator stops */
  amb_real weight; /* set-point weight: share of the reference that kp acts on */
  amb_real iu_min; /* limits of the output [A] */
  amb_real iu_max;
  int sections;            /* number of sections in series, before the limits */
  const amb_real *section; /* [sections][AMB_SECTION] */
} amb_pid;

/* The integral exists three times, to detect a bit flip in memory. */
typedef struct amb_pid_state {
  amb_real integral; /* [A] */
  amb_real last_r;   /* last good reference [m] */
  amb_real last_x;   /* last good position [m] */
  amb_real velocity; /* filtered derivative of x [m/s] */
  amb_real copy[2];  /* of the integral [A] */
  amb_real section[AMB_SECTIONS][2];
  bool started;
  bool flows; /* whether the sections are initialised */
} amb_pid_state;

/* Reset with the integrator at `integral` [A]. */
void amb_pid_reset(amb_pid_state *state, amb_real integral);

/* One sample: reference r [m], position x [m], and the velocity [m/s] of an estimator (`velocity`
 * NULL: the filtered derivative of x). Returns in iu the commanded control current [A] within its
 * limits. Returns AMB_OK, or flags: AMB_SATURATED, AMB_MISSING (position or velocity not finite, or
 * too large to be squared), AMB_BAD_CONTROL (reference likewise); the last valid values are used
 * then. */
amb_status amb_pid_step(const amb_pid *pid, amb_pid_state *state, amb_real r, amb_real x,
                        const amb_real *velocity, amb_real *iu);

AMB_EXTERN_C_END

#endif
