/* Calibration on the running rig: numbers that a tool writes, checked, worked into a second set of
 * constants by a slower task, and taken over between two samples.
 *
 * `wanted` is written by the tool, then `request` is counted up. amb_calibration_update, called by
 * a task that the sampling interrupts and never the other way about, looks at it: what is good is
 * worked into the set that does not fly, and the pointer that is then given out is all that the
 * caller changes. The sample that follows flies by it. `in_use` is what flies, `answered` the last
 * request that was looked at, `refused` what of it was not good. */
#ifndef AMBKIT_CALIBRATION_H
#define AMBKIT_CALIBRATION_H

#include "ambkit/control.h"
#include "ambkit/scaled.h"
#include <stdint.h>

AMB_EXTERN_C_BEGIN

/* What a number is of: its kind, and an index where there are several of the kind. */
typedef enum amb_parameter {
  AMB_VAR_Y, /* variance of a sensor's measurement [m^2] */
  AMB_VAR_U, /* variance of a control signal [V^2] */
  AMB_VAR_D, /* what a noise of the model grows by in a sample: a disturbance force's variance [N^2]
              */
  AMB_GATE,  /* innovations beyond so many standard deviations are outliers [1] */
  AMB_MASS,  /* of the rotor [kg]; inertia, weight and bending stiffness go with it */
  AMB_STRONG, /* a magnet's force over that of the export [1]: k over the exported k */
  AMB_KP,     /* gains of a PID: [A/m], */
  AMB_KI,     /* [A/(m s)], */
  AMB_KD,     /* [A s/m], */
  AMB_T_F,    /* derivative filter [s], */
  AMB_T_T,    /* tracking time [s], */
  AMB_WEIGHT  /* set-point weight [1] */
} amb_parameter;

/* The most numbers of a machine, in the order of their kinds: with one of each, a number is at its
 * kind. */
#define AMB_PARAMETERS (AMB_SENSORS + (7 * AMB_CONTROLS) + AMB_NOISES + AMB_FORCES + 2)

/* What does not change. */
typedef struct amb_calibration_base {
  const amb_control *control;          /* as exported */
  int parameters;                      /* how many numbers there are, <= AMB_PARAMETERS */
  unsigned char kind[AMB_PARAMETERS];  /* amb_parameter of each, ... */
  unsigned char index[AMB_PARAMETERS]; /* ... and of which sensor, control, noise, magnet or PID */
  amb_real exported[AMB_PARAMETERS];
  amb_real low[AMB_PARAMETERS];  /* limits of each: within them all sets hold the rotor, with ... */
  amb_real high[AMB_PARAMETERS]; /* ... margins that the export names */
  amb_real mass;                 /* of the exported rotor [kg] */
  amb_real carried[AMB_FORCES];  /* what each magnet carries of the weight, as far as the filter */
  amb_real bias[AMB_FORCES];     /* knows it [N], and its bias force [N]: parts of f_0 */
} amb_calibration_base;

/* A set of constants that flies, or is worked on. It begins with what a controller points to. */
typedef struct amb_calibration_set {
  amb_control control;
  amb_kalman kf;
  amb_scaled scaled[AMB_FORCES];
  amb_magnet magnet[AMB_FORCES];
  amb_estimator estimator;
  amb_pid pid[AMB_CONTROLS];
  amb_controllers law;
  amb_real numbers[AMB_PARAMETERS]; /* that it was made from */
} amb_calibration_set;

/* The same, and its amb_calibration_sum. */
typedef struct amb_calibration_kept {
  union {
    amb_calibration_set set;
    uint32_t word[sizeof(amb_calibration_set) / sizeof(uint32_t)];
  } of;
  uint32_t sum;
} amb_calibration_kept;

/* All that a tool sees stands first: numbers, then counts of 32 bits. */
typedef struct amb_calibration {
  amb_real wanted[AMB_PARAMETERS];
  amb_real in_use[AMB_PARAMETERS];
  uint32_t request;
  uint32_t answered;
  uint32_t refused; /* 0; or a sum of 1 << kind, of all bits where they do not go together */
  uint32_t flying;  /* 0: as exported; else the set that flies */
  uint32_t copy[2]; /* of that: a bit in memory may flip */
  amb_calibration_kept kept[2];
} amb_calibration;

/* A sum over the words of a set, which no single bit leaves as it is. */
uint32_t amb_calibration_sum(const amb_calibration_kept *kept);

/* At power-on: what was exported flies. */
void amb_calibration_init(const amb_calibration_base *base, amb_calibration *calibration);

/* Look at a request, and work anew what a bit that flipped in memory has spoiled. Returns the
 * constants to fly by from now on. */
const amb_control *amb_calibration_update(const amb_calibration_base *base,
                                          amb_calibration *calibration);

/* What a sample is to fly by: what amb_calibration_update gave, or as exported where a bit of that
 * has flipped since. Another amb_control must be that of an amb_calibration_kept with its sum. */
const amb_control *amb_calibration_flown(const amb_calibration_base *base, amb_works_by *works_by);

AMB_EXTERN_C_END

#endif
