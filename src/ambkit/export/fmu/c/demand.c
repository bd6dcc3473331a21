#include "model.h"

/* What a controller looks at when a sample begins is all there is to do in it. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  value[VR_u] = model->u;
}
