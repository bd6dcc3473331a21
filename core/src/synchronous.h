/* Synchronous states of a rotor whose angle is estimated: what synchronous.c and direction.c share.
 */
#ifndef AMBKIT_SYNCHRONOUS_H
#define AMBKIT_SYNCHRONOUS_H

#include "ambkit/turning.h"

#define AMB_REVOLUTION AMB_C(6.283185307179586)

/* An entry of L, whose values come first in the model's numbers; NULL: not in its pattern. */
AMB_INLINE amb_real *amb_transition_entry(const amb_model *model, amb_real numbers[], int row,
                                          int column)
{
  amb_real *result = NULL;
  for (int k = model->L.start[row]; k < (int)model->L.start[row + 1]; k++) {
    if ((int)model->L.column[k] == column) {
      result = &numbers[k];
    }
  }
  return result;
}

/* Restarts the sums of the corrections. */
void amb_direction_restart(amb_direction *direction);

/* The rotation in the detected direction; when it changes, the pairs restart. */
amb_rotation amb_directed(const amb_speed_error *error, const amb_kalman *kf,
                          const amb_kalman_state *state, amb_direction *direction,
                          const amb_rotation *rotation);

/* Prediction of the pairs for the next sample, and the angle until then at this speed. */
void amb_direction_predict(const amb_speed_error *error, const amb_kalman *kf, amb_real numbers[],
                           const amb_real mean[], amb_real speed, amb_direction *direction);

#endif
