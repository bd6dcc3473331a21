/* Calibration on the running rig: values written by a tool are checked, worked into a second set of
 * constants by a slower task, and switched to between two samples.
 *
 * The tool writes `wanted`, then increments `request`. amb_calibration_update, called by a task
 * that the sampling interrupts and never the reverse, evaluates it: valid values are worked into
 * the inactive set, and the caller only replaces the pointer that it returns. The next sample uses
 * that set. `in_use` are the active values, `answered` is the last evaluated request, `refused` the
 * kinds that were invalid.
 */
#ifndef AMBKIT_CALIBRATION_H
#define AMBKIT_CALIBRATION_H

#include "ambkit/control.h"
#include "ambkit/scaled.h"
#include <stdint.h>

AMB_EXTERN_C_BEGIN

/* Kind of a value; an index distinguishes several of a kind. */
typedef enum amb_parameter {
  AMB_VAR_Y,  /* variance of a sensor's measurement [m^2] */
  AMB_VAR_U,  /* variance of a control signal [V^2] */
  AMB_VAR_D,  /* variance by which a noise of the model grows in a sample: a disturbance force's
                 [N^2] */
  AMB_GATE,   /* innovations beyond this many standard deviations are outliers [1] */
  AMB_MASS,   /* of the rotor [kg]; inertia, weight and bending stiffness scale with it */
  AMB_STRONG, /* force of a magnet over that of the export [1]: k over the exported k */
  AMB_KP,     /* gains of a PID: [A/m], */
  AMB_KI,     /* [A/(m s)], */
  AMB_KD,     /* [A s/m], */
  AMB_T_F,    /* derivative filter [s], */
  AMB_T_T,    /* tracking time [s], */
  AMB_WEIGHT  /* set-point weight [1] */
} amb_parameter;

/* Maximum number of values, in the order of their kinds: with one of each, the index is the kind.
 * */
#define AMB_PARAMETERS (AMB_SENSORS + (7 * AMB_CONTROLS) + AMB_NOISES + AMB_FORCES + 2)

/* Constant part. */
typedef struct amb_calibration_base {
  const amb_control *control;          /* as exported */
  int parameters;                      /* number of values, <= AMB_PARAMETERS */
  unsigned char kind[AMB_PARAMETERS];  /* amb_parameter of each, ... */
  unsigned char index[AMB_PARAMETERS]; /* ... and of which sensor, control, noise, magnet or PID */
  amb_real exported[AMB_PARAMETERS];
  amb_real low[AMB_PARAMETERS];  /* limits of each: within them every set holds the rotor, with ...
                                  */
  amb_real high[AMB_PARAMETERS]; /* ... margins that the export states */
  amb_real mass;                 /* of the exported rotor [kg] */
  amb_real carried[AMB_FORCES];  /* share of the weight carried by each magnet, as in the filter's
                                    ... */
  amb_real bias[AMB_FORCES];     /* ... model [N], and its bias force [N]: parts of f_0 */
} amb_calibration_base;

/* A set of constants, active or in preparation. It begins with what a controller points to. */
typedef struct amb_calibration_set {
  amb_control control;
  amb_kalman kf;
  amb_scaled scaled[AMB_FORCES];
  amb_magnet magnet[AMB_FORCES];
  amb_estimator estimator;
  amb_pid pid[AMB_CONTROLS];
  amb_controllers law;
  amb_real numbers[AMB_PARAMETERS]; /* its values */
} amb_calibration_set;

/* The same, with its amb_calibration_sum. */
typedef struct amb_calibration_kept {
  union {
    amb_calibration_set set;
    uint32_t word[sizeof(amb_calibration_set) / sizeof(uint32_t)];
  } of;
  uint32_t sum;
} amb_calibration_kept;

/* Everything for the tool comes first: values, then counters of 32 bits. */
typedef struct amb_calibration {
  amb_real wanted[AMB_PARAMETERS];
  amb_real in_use[AMB_PARAMETERS];
  uint32_t request;
  uint32_t answered;
  uint32_t refused; /* 0; or a sum of 1 << kind, all bits if the values contradict each other */
  uint32_t flying;  /* 0: as exported; else the active set */
  uint32_t copy[2]; /* of the previous: a bit in memory may flip */
  amb_calibration_kept kept[2];
} amb_calibration;

/* Checksum of a set, which detects any single bit flip. */
uint32_t amb_calibration_sum(const amb_calibration_kept *kept);

/* At power-on: the exported values are active. */
void amb_calibration_init(const amb_calibration_base *base, amb_calibration *calibration);

/* Evaluate a request, and repair constants in which a bit of memory has flipped. Returns the
 * constants to use from now on. */
const amb_control *amb_calibration_update(const amb_calibration_base *base,
                                          amb_calibration *calibration);

/* Constants for the next sample: those of amb_calibration_update, or the exported ones if a bit of
 * them has flipped since. Any other amb_control must be that of an amb_calibration_kept with its
 * sum. */
const amb_control *amb_calibration_flown(const amb_calibration_base *base, amb_works_by *works_by);

AMB_EXTERN_C_END

#endif
