/* What a model says of a rotor at rest, which is where a lost one is looked for (envelope.c). */
#ifndef AMBKIT_AT_REST_H
#define AMBKIT_AT_REST_H

#include "ambkit/model.h"

AMB_EXTERN_C_BEGIN

/* All states of a rotor at rest that is off by 1 m in position i, or what else state i is. */
void amb_rest_off_by_one(const amb_model *model, int i, amb_real states[AMB_STATES]);

/* All states of a rotor at rest where sensor r shows 1 m. */
void amb_rest_where_shown(const amb_model *model, int r, amb_real states[AMB_STATES]);

/* Whether sensor r shows something of these states. */
bool amb_rest_sees(const amb_model *model, int r, const bool these[AMB_STATES]);

/* Add the velocities that move these positions, and what sensors show of them. */
void amb_rest_add_followers(const amb_model *model, bool these[AMB_STATES]);

AMB_EXTERN_C_END

#endif
