/* The plant as a model: amplifiers, magnets, rotor, sensors. */
#ifndef AMBKIT_FMU_PLANT_MODEL_H
#define AMBKIT_FMU_PLANT_MODEL_H

#include "rig.h"

typedef struct amb_unit {
  amb_rig rig;
  amb_plant_state state;             /* at the end of what it has gone on by */
  amb_real demanded[AMB_PLANT_AXES]; /* control currents of the sample before [A] */
  amb_real frozen_y[AMB_SENSORS];    /* what the sensors showed last before they froze [m] */
  amb_glimpse between;
  int held; /* where an importer integrates it: at which stop the rotor stays, 1, -1 or 0 */
} amb_unit;

/* Take over control signals, switch and what the sensors' freezing keeps, as they are now. */
void amb_plant_demand(amb_unit *model, const amb_plant *plant, const double value[]);

/* Write what only importers that integrate it ask for. */
void amb_plant_show_rates(const amb_unit *model, double value[]);

#endif
