/* The plant as a model: amplifier, magnet, rotor, sensor. */
#ifndef AMBKIT_FMU_PLANT_MODEL_H
#define AMBKIT_FMU_PLANT_MODEL_H

#include "rig.h"

typedef struct amb_unit {
  amb_rig rig;
  amb_plant_state state; /* at the end of what it has gone on by */
  amb_real demanded;     /* control current of the sample before [A] */
  amb_real frozen_y;     /* what the sensor showed last before it froze [m] */
  amb_glimpse between;
} amb_unit;

#endif
