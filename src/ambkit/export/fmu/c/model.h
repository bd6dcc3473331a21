/* The model's interface for the FMI layers: its variables, and six functions.
 *
 * A model is plain data. Everything that changes is in an amb_unit without pointers, so that a copy
 * of the bytes is a copy of the model. `description.h` is written by the export: it names the
 * variables (VR_y, ...), in the order of their value references, and includes the header of the
 * model kind, which defines amb_unit.
 */
#ifndef AMBKIT_FMU_MODEL_H
#define AMBKIT_FMU_MODEL_H

#include "ambkit/status.h"
#include "description.h"

typedef enum amb_causality {
  AMB_TIME,
  AMB_FIXED,
  AMB_TUNABLE,
  AMB_INPUT,
  AMB_OUTPUT,
  AMB_LOCAL
} amb_causality;

/* Properties of a value that can be set; AMB_LOSABLE: NaN and infinity are allowed, as from a lost
 * sensor. */
typedef enum amb_limit { AMB_ANY, AMB_NOT_NEGATIVE, AMB_POSITIVE, AMB_LOSABLE } amb_limit;

typedef struct amb_variable {
  const char *name;
  const char *unit;
  amb_causality role;
  amb_limit limit;
  bool integer;
  double start;
} amb_variable;

extern const amb_variable amb_variables[AMB_VARIABLES];
extern const double amb_sampling_time; /* [s] */
extern const char amb_token[];         /* hash of all inputs of the export */

/* Set the parameters among the values, finite and within their limits. Returns AMB_OK, or
 * AMB_BAD_PARAMETER if their combination is invalid; the model is then unchanged. */
amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES]);

/* Start from the parameters and inputs among the values. Returns as amb_unit_tune. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES]);

/* Advance by one sampling time from a sample, with constant inputs. */
void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES]);

/* Advance by a part of it, `from` to `to` after a sample [1, of the sampling time], 0 <= from < to
 * <= 1, where `to` is the end of a communication step that is no integer multiple. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES]);

/* Write the outputs among the values. */
void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES]);

#endif
