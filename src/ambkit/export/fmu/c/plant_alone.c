#include "plant_model.h"

/* A dead time is no differential equation. */
void amb_plant_show_rates(const amb_unit *model, double value[])
{
  (void)model;
  (void)value;
}
