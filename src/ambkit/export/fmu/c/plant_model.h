/* The plant as a model: amplifiers, magnets, rotor, sensors. */
#ifndef AMBKIT_FMU_PLANT_MODEL_H
#define AMBKIT_FMU_PLANT_MODEL_H

#include "rig.h"

typedef struct amb_unit {
  amb_rig rig;
  amb_plant_state state;             /* at the time reached */
  amb_real demanded[AMB_PLANT_AXES]; /* control currents of the previous sample [A] */
  amb_real frozen_y[AMB_SENSORS];    /* last sensor outputs before they froze [m] */
  amb_glimpse between;
  int held; /* if the importer integrates: the stop at which the rotor stays, 1, -1 or 0 */
} amb_unit;

/* Set control signals, switch and frozen readings from the present values. */
void amb_plant_demand(amb_unit *model, const amb_plant *plant, const double value[]);

/* Write outputs that only integrating importers need. */
void amb_plant_show_rates(const amb_unit *model, double value[]);

#endif
