/* Equilibrium states of a rotor, to which the envelope resets a lost estimate (envelope.c). */
#ifndef AMBKIT_AT_REST_H
#define AMBKIT_AT_REST_H

#include "ambkit/model.h"

AMB_EXTERN_C_BEGIN

/* All states of a rotor at rest with state i at 1 (for a position: displaced by 1 m). */
void amb_rest_off_by_one(const amb_model *model, int i, amb_real states[AMB_STATES]);

/* All states of a rotor at rest with a reading of 1 m by sensor r. */
void amb_rest_where_shown(const amb_model *model, int r, amb_real states[AMB_STATES]);

/* Whether the reading of sensor r depends on any of these states. */
bool amb_rest_sees(const amb_model *model, int r, const bool these[AMB_STATES]);

/* Adds the velocities of these positions, and the readings that depend on them. */
void amb_rest_add_followers(const amb_model *model, bool these[AMB_STATES]);

AMB_EXTERN_C_END

#endif
