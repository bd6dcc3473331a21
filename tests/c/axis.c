/* The numbers of the model that is built in, for programs that run it by loops. Compiled without
 * AMB_MODEL_LOOPS, whatever the others are. */
#include "ambkit/model.h"
#include "axis_numbers.h"

void axis_compute(amb_real T, amb_real m, amb_real K_sen, amb_real T_sen, bool as_printed,
                  axis_numbers *numbers)
{
  amb_model model;
  amb_model_init(&model, T, m, K_sen, T_sen);
  if (as_printed)
    amb_model_as_printed(&model);
#define COPY(name) numbers->name = model.name
  AMB_MODEL_FIELDS(COPY);
#undef COPY
}
