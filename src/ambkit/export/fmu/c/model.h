/* What the FMI layers know of a model: its variables, and six functions.
 *
 * A model is plain data. All that changes in it is in an amb_unit, without pointers, so that a
 * copy of the bytes is a copy of the model. `description.h` is written by the export: it names the
 * variables (VR_y, ...), in the order of their value references, and includes the header of the
 * kind of model that this is, which defines amb_unit.
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

/* Of a value that is set; AMB_LOSABLE: it may also be NaN or infinite, as of a lost sensor. */
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
extern const char amb_token[];         /* hash of all that the model was made from */

/* Take over the parameters among the values: finite, and within their limits. Returns AMB_OK, or
 * AMB_BAD_PARAMETER where they are not usable together; then the model stays as it was. */
amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES]);

/* Start from the parameters and the inputs among the values. Returns as amb_unit_tune does. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES]);

/* On by one sampling time from a sample on, with the inputs among the values held. */
void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES]);

/* On by a part of it, `from` to `to` after a sample [1, of the sampling time], 0 <= from < to <= 1,
 * where `to` ends a communication step that is no whole multiple. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES]);

/* Write the outputs among the values. */
void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES]);

#endif
