/* An instance of the model, in the terms that FMI 2.0 and 3.0 share.
 *
 * The FMI layers (fmi2.c, fmi3.c) only translate. A refused call leaves the instance unchanged and
 * logs the reason in one line.
 */
#ifndef AMBKIT_FMU_INSTANCE_H
#define AMBKIT_FMU_INSTANCE_H

#include "model.h"
#include <stdint.h>

/* The first values of fmi2Status and fmi3Status, which are equal. */
typedef enum amb_answer { AMB_DONE, AMB_WARNING, AMB_DISCARD, AMB_ERROR } amb_answer;

typedef enum amb_mode {
  AMB_INSTANTIATED,
  AMB_INITIALIZING,
  AMB_STEPPING,
  AMB_TERMINATED,
  AMB_EVENTS, /* these two if the importer integrates */
  AMB_CONTINUOUS
} amb_mode;

/* Everything that changes. Time is start + (samples + part) times the sampling time: steps
 * accumulate to less than a sample, then start again, so there is no drift. */
typedef struct amb_point {
  amb_mode mode;
  double start;   /* [s] */
  double samples; /* an integer */
  double part;    /* fraction of a sample, 0 to less than 1 */
  double time;    /* if the importer integrates, in place of these two [s] */
  double value[AMB_VARIABLES];
  amb_unit model;
} amb_point;

typedef struct amb_instance amb_instance;

/* Callback for messages to the importer. */
typedef void (*amb_tell)(const amb_instance *self, amb_answer answer, const char *text);

/* Set the time since the start [s], inputs and parameters, if the importer integrates. */
typedef void amb_follow(amb_unit *model, double time, const double value[AMB_VARIABLES]);

struct amb_instance {
  amb_point now;
  amb_tell tell;
  amb_follow *follow; /* NULL: co-simulation */
};

/* The model's functions for it; NULL: co-simulation only. */
extern amb_follow *const amb_exchange;

/* With the present time, inputs and parameters. */
void amb_catch_up(amb_instance *self);

/* The standard's name of a message category. */
const char *amb_category(amb_answer answer);

/* Log why a call is refused, and return the status. */
amb_answer amb_refuse(const amb_instance *self, amb_answer answer, const char *format, ...);

/* Whether the token is that of this model; logs if not. */
bool amb_same_token(const amb_instance *self, const char *token);

double amb_time(const amb_instance *self);

/* As after instantiation, with all start values. */
void amb_reset(amb_instance *self);
amb_answer amb_enter_initialization(amb_instance *self, double start);
amb_answer amb_exit_initialization(amb_instance *self);
amb_answer amb_terminate(amb_instance *self);

/* n variables by their value references. Nothing is set if one of the values is refused. */
amb_answer amb_get_reals(amb_instance *self, const uint32_t *vr, size_t n, double *values);
amb_answer amb_get_integers(amb_instance *self, const uint32_t *vr, size_t n, int32_t *values);
amb_answer amb_set_reals(amb_instance *self, const uint32_t *vr, size_t n, const double *values);

/* Advance from `time` by any `step` [s]; samples are at integer multiples of the sampling time. */
amb_answer amb_do_step(amb_instance *self, double time, double step);

/* Copies of everything that changes. `amb_save` writes to *point, which it allocates if NULL. */
amb_answer amb_save(const amb_instance *self, amb_point **point);
amb_answer amb_restore(amb_instance *self, const amb_point *point);

/* The same as bytes, with a checksum that also identifies the model. */
size_t amb_serialized_size(void);
amb_answer amb_serialize(const amb_instance *self, const amb_point *point, unsigned char *bytes,
                         size_t size);
amb_answer amb_deserialize(const amb_instance *self, const unsigned char *bytes, size_t size,
                           amb_point **point);

#endif
