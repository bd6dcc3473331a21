#include "ambkit/sampling.h"
#include "square.h"

/* The demand that acts on an amplifier from a share of the sample on: a past one, or the present
 * one. */
static int acting(const amb_plan *plan, int column, double after)
{
  int source = column;
  for (int k = 0; k < plan->lates; k++) {
    const amb_late *late = &plan->late[k];
    if (column == (plan->states + plan->forces + late->control)) {
      const int which = late->count - ((after >= late->share) ? 1 : 0);
      source = (which > 0) ? (int)late->past[which - 1] : column;
    }
  }
  return source;
}

/* Matrix of the first n states of the continuous model, from a share of the sample on. */
static void generate(const amb_plan *plan, unsigned int use, double after, int n, double A[])
{
  for (int i = 0; i < (n * n); i++) {
    A[i] = 0.0;
  }
  for (int k = 0; k < plan->terms; k++) {
    const int row = (int)plan->row[k];
    const int column = acting(plan, (int)plan->column[k], after);
    if ((((unsigned int)plan->use[k] & use) != 0U) && (row < n) && (column < n)) {
      A[(row * n) + column] += plan->value[k];
    }
  }
}

/* A force that follows its current was counted twice: its mean is already in the held force. */
static void hold_means(const amb_plan *plan, int size, double Phi[])
{
  const int n = plan->states;
  const int p = plan->forces;
  const int to = n + p + plan->controls;
  for (int f = 0; f < p; f++) {
    const double *current = &Phi[(to + p + f) * size];
    for (int i = 0; (i < n) && !amb_is_zero(plan->k_i[f]); i++) {
      const double held = plan->k_i[f] * Phi[(i * size) + n + f];
      for (int j = 0; j < to; j++) {
        const bool force = (j >= n) && (j < (n + p));
        Phi[(i * size) + j] -= force ? 0.0 : (held * current[j]);
      }
    }
  }
}

/* Shifts the past demands by one sample. */
static void shift(const amb_plan *plan, int size, double Phi[])
{
  for (int k = 0; k < plan->lates; k++) {
    const amb_late *late = &plan->late[k];
    int from = plan->states + plan->forces + late->control;
    for (int i = 0; i < late->count; i++) {
      double *row = &Phi[(int)late->past[i] * size];
      for (int j = 0; j < size; j++) {
        row[j] = (j == from) ? 1.0 : 0.0;
      }
      from = (int)late->past[i];
    }
  }
}

bool amb_plan_sampled(const amb_plan *plan, double Phi[], double N[], double work[])
{
  const int n = plan->states;
  const int size = AMB_PLAN_SIZE(plan);
  double *A = work;
  double *piece = &work[size * size];
  double *room = &work[2 * size * size];
  amb_square_identity(size, Phi);
  double start = 0.0;
  while (start < 1.0) { /* from one change of a demand to the next */
    double end = 1.0;
    for (int k = 0; k < plan->lates; k++) {
      const double share = plan->late[k].share;
      end = ((share > start) && (share < end)) ? share : end;
    }
    generate(plan, AMB_MOVES, start, size, A);
    if (!amb_transition(size, A, (end - start) * plan->T, piece, room)) {
      return false;
    }
    if (start > 0.0) {
      amb_square_multiply(size, piece, Phi, 1.0, room);
      amb_square_copy(size * size, room, Phi);
    } else {
      amb_square_copy(size * size, piece, Phi);
    }
    start = end;
  }
  hold_means(plan, size, Phi);
  shift(plan, size, Phi);
  generate(plan, AMB_SPREADS, 0.0, n, A);
  return amb_process_noise(n, A, plan->T, plan->noises, plan->intensity, N, room);
}
