/* Replay of faults: the error that they make in the filter is stepped along the window, and their
 * sizes are fitted without linearising in them. */
#ifndef AMBKIT_ISOLATION_REPLAY_H
#define AMBKIT_ISOLATION_REPLAY_H

#include "isolation_sweep.h"

AMB_EXTERN_C_BEGIN

#define MOST_COLUMNS 4 /* of two faults */

/* Faults that began `since` samples ago, and the sizes that explain most of the innovations. */
typedef struct replay {
  int columns;
  int column[MOST_COLUMNS];
  int since;
  bool promised;       /* `explains` is predicted from a fit of one of two faults */
  amb_real explains;   /* l; 0 before the first fit */
  amb_real correlated; /* sum of products of successive residuals over S */
  amb_real size[MOST_COLUMNS];
  amb_real variance[MOST_COLUMNS];
} replay;

/* l of some columns together by their information M and g; sizes and variances unless NULL. A
 * column that depends on those before it explains nothing more. */
amb_real amb_explained(int count, amb_real M[MOST_COLUMNS][MOST_COLUMNS],
                       const amb_real g[MOST_COLUMNS], amb_real size[], amb_real variance[]);

/* Predict l of the best sizes by one Gauss-Newton step from those given. */
void amb_replay_promise(const samples *in, replay *of);

/* Fit the sizes by Gauss-Newton steps from those given. */
void amb_replay_fit(const samples *in, replay *of);

AMB_EXTERN_C_END

#endif
