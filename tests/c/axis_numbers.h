/* The numbers of the model that is built in, for programs that run the same model by loops. */
#ifndef AMBKIT_TESTS_AXIS_NUMBERS_H
#define AMBKIT_TESTS_AXIS_NUMBERS_H

#include "../../bindings/axial_fields.h"
#include "ambkit/real.h"

typedef struct axis_numbers {
#define AXIS_NUMBER(name) amb_real name
  AMB_MODEL_FIELDS(AXIS_NUMBER);
#undef AXIS_NUMBER
} axis_numbers;

void axis_compute(amb_real T, amb_real m, amb_real K_sen, amb_real T_sen, bool as_printed,
                  axis_numbers *numbers);

#endif
