#include "ambkit/contact.h"
#include "ambkit/root.h"
#include "kalman_step.h"

/* The contact of a ring. */
typedef struct touching {
  int axes; /* 1 or 2 */
  int axis[2];
  amb_real way[2];            /* outwards [1] ... */
  amb_real act[2];            /* ... and against the force of a newton N, friction included */
  amb_real depth;             /* [m] */
  amb_real elastic;           /* force at it [N] */
  amb_real force;             /* N [N]; 0: free */
  amb_real k;                 /* tangent by the depth [N/m] ... */
  amb_real c;                 /* ... and by its rate [N s/m] */
  amb_real variance;          /* of N [N^2]: by the states ... */
  amb_real open;              /* ... and beside them */
  amb_real w[AMB_STATES];     /* both, by the states */
  amb_real moved[AMB_STATES]; /* u: what a newton leaves in the states */
  amb_real with[AMB_STATES];  /* P w, then A P w */
} touching;

AMB_INLINE amb_real times(int n, const amb_real row[AMB_STATES], const amb_real states[AMB_STATES])
{
  amb_real sum = row[0] * states[0];
  for (int i = 1; i < n; i++) {
    sum += row[i] * states[i];
  }
  return sum;
}

/* Elastic force at a depth and its tangent, at most 3 mass / T^2. */
AMB_INLINE void elastic(const amb_contact *own, int ring, touching *at)
{
  const amb_real steep = AMB_C(1.5) * own->stiffness[ring];
  const amb_real stiffest = AMB_C(0.5) / own->moves[ring];
  const amb_real last = stiffest / steep; /* root of the depth of the stiffest tangent */
  const amb_real edge = last * last;
  const amb_real curved = amb_at_most(at->depth, edge);
  const amb_real root = amb_root(curved);
  at->k = steep * root;
  at->elastic = own->stiffness[ring] * curved * root;
  if (at->depth > edge) {
    at->elastic += stiffest * (at->depth - edge);
  }
}

/* Friction of a ring as a share of N, against what slides along it. */
AMB_INLINE amb_real rub(const amb_contact *own, int ring, amb_real force, amb_real slip)
{
  const amb_real most = own->friction[ring] * force;
  const amb_real held = AMB_C(0.5) / own->hastens[ring] * slip; /* brings it to rest in a sample */
  return amb_clamp(held, -most, most) / force;
}

/* Where a mean of the states touches a ring beside forces F; leaves the arrays by states alone. */
AMB_INLINE bool touch(const amb_model *model, const amb_contact *own, int ring,
                      const amb_real mean[AMB_STATES], const amb_real F[AMB_FORCES], touching *at)
{
  const int n = amb_states(model);
  const bool two = (amb_forces(model) > 1) && (own->second[ring] != own->first[ring]);
  at->axes = two ? 2 : 1;
  at->axis[0] = (int)own->first[ring];
  at->axis[1] = (int)own->second[ring];
  at->way[0] = AMB_C(0.0);
  at->way[1] = AMB_C(0.0);
  at->act[0] = AMB_C(0.0);
  at->act[1] = AMB_C(0.0);
  at->elastic = AMB_C(0.0);
  at->force = AMB_C(0.0);
  at->k = AMB_C(0.0);
  at->c = AMB_C(0.0);
  at->variance = AMB_C(0.0);
  at->open = AMB_C(0.0);
  const amb_real F_a = F[at->axis[0]];
  const amb_real F_b = two ? F[at->axis[1]] : AMB_C(0.0);
  const amb_real moves = own->moves[ring];
  const amb_real a = times(n, own->displacement[at->axis[0]], mean) + moves * F_a;
  const amb_real b =
      two ? (times(n, own->displacement[at->axis[1]], mean) + moves * F_b) : AMB_C(0.0);
  const amb_real far = two ? amb_root(a * a + b * b) : amb_magnitude(a);
  if (!(far > own->clearance[ring])) {
    return false;
  }
  at->depth = far - own->clearance[ring];
  at->way[0] = a / far;
  at->way[1] = b / far;
  const amb_real hastens = own->hastens[ring];
  const amb_real v = times(n, own->velocity[at->axis[0]], mean) + hastens * F_a;
  const amb_real w =
      two ? (times(n, own->velocity[at->axis[1]], mean) + hastens * F_b) : AMB_C(0.0);
  elastic(own, ring, at);
  at->c = amb_at_most(AMB_C(1.5) * own->damping[ring] * at->elastic, AMB_C(0.5) / hastens);
  const amb_real inward = at->way[0] * v + at->way[1] * w;
  const amb_real force = at->elastic + at->c * inward;
  if (!(force > AMB_C(0.0))) {
    return false;
  }
  const amb_real give = AMB_C(1.0) / (AMB_C(1.0) + moves * at->k + hastens * at->c);
  at->force = give * force;
  at->k *= give;
  at->c *= give;
  at->act[0] = at->way[0];
  at->act[1] = at->way[1];
  if (two) {
    const amb_real slip = own->surface[ring] + at->way[0] * w - at->way[1] * v;
    const amb_real share = rub(own, ring, at->force, slip);
    at->act[0] -= share * at->way[1];
    at->act[1] += share * at->way[0];
  }
  return true;
}

AMB_INLINE void add_force(const touching *at, amb_real F[AMB_FORCES])
{
  for (int a = 0; a < at->axes; a++) {
    F[at->axis[a]] -= at->force * at->act[a];
  }
}

amb_status amb_contact_forces(const amb_estimator *self, const amb_real mean[AMB_STATES],
                              const amb_real iu[AMB_CONTROLS], amb_real scale,
                              amb_real F[AMB_FORCES], amb_real N[AMB_FORCES])
{
  const amb_kalman *kf = self->kf;
  const amb_contact *own = (const amb_contact *)self->own;
  amb_status status = AMB_OK;
  amb_stiffness unused[AMB_FORCES];
  amb_step_forces(kf, self->magnet, iu, mean, F, unused);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] = scale * F[f] + kf->set.f_0[f];
    N[f] = AMB_C(0.0);
  }
  for (int ring = 0; ring < own->rings; ring++) {
    touching at;
    if (touch(&kf->model, own, ring, mean, F, &at)) {
      status = AMB_CONTACT;
      add_force(&at, N);
    }
  }
  return status;
}

/* Adds P w, of the upper triangle of P. */
AMB_INLINE void spread(int n, const amb_real P[AMB_TRIANGLE], const amb_real w[AMB_STATES],
                       amb_real with[AMB_STATES])
{
  int entry = 0;
  for (int i = 0; i < n; i++) {
    with[i] += P[entry] * w[i];
    entry++;
    for (int j = i + 1; j < n; j++) {
      with[i] += P[entry] * w[j];
      with[j] += P[entry] * w[i];
      entry++;
    }
  }
}

/* N and its variance, of a depth that is known by P only. */
AMB_INLINE void bend(int n, const amb_contact *own, int ring, touching *at)
{
  /* A least E, so that the quotient is finite whatever it is of. */
  const amb_real least = AMB_C(1e-9) * own->clearance[ring] / own->moves[ring];
  const amb_real E = amb_at_least(at->elastic, least);
  at->variance = times(n, at->w, at->with);
  const amb_real share = at->variance / (AMB_C(6.0) * E * E);
  const amb_real bent = amb_at_most(amb_at_least(share, AMB_C(0.0)), AMB_C(6.0));
  const amb_real open = AMB_C(2.0) * bent * bent + own->scatter_squared;
  at->open = open * at->force * at->force;
  at->force += bent * at->force;
}

/* Rings that are touched, each with w, u and P w. */
AMB_INLINE int touched(const amb_kalman *kf, const amb_contact *own, const amb_kalman_state *s,
                       const amb_real F[AMB_FORCES], touching at[AMB_FORCES])
{
  const int n = amb_states(&kf->model);
  int count = 0;
  for (int ring = 0; ring < own->rings; ring++) {
    touching *now = &at[count];
    amb_clear(n, now->w); /* though it be free: proofs follow no count */
    amb_clear(n, now->moved);
    amb_clear(n, now->with);
    if (touch(&kf->model, own, ring, s->mean, F, now)) {
      count++;
      for (int a = 0; a < now->axes; a++) {
        const amb_real *row = own->displacement[now->axis[a]];
        const amb_real *rate = own->velocity[now->axis[a]];
        amb_real moved[AMB_STATES];
        amb_model_pushed(&kf->model, now->axis[a], moved);
        for (int i = 0; i < n; i++) {
          now->w[i] += now->way[a] * (now->k * row[i] + now->c * rate[i]);
          now->moved[i] += now->act[a] * moved[i];
        }
      }
      spread(n, s->cov, now->w, now->with);
      bend(n, own, ring, now);
    }
  }
  return count;
}

/* A P A' of the free rotor becomes that of one in contact. */
AMB_INLINE void stiffen(const amb_kalman *kf, int count, touching at[AMB_FORCES],
                        const amb_stiffness k[AMB_FORCES], amb_real P[AMB_TRIANGLE])
{
  static const amb_real idle[AMB_CONTROLS] = {AMB_C(0.0)};
  const int n = amb_states(&kf->model);
  amb_real both[AMB_FORCES][AMB_FORCES]; /* w' P w of two rings [N^2] */
  for (int r = 0; r < count; r++) {
    for (int s = 0; s < count; s++) {
      both[r][s] = (r == s) ? (at[r].variance + at[r].open) : times(n, at[r].w, at[s].with);
    }
  }
  for (int r = 0; r < count; r++) {
    amb_step_carry(&kf->model, k, NULL, idle, at[r].with);
    for (int s = 0; s < count; s++) {
      for (int i = 0; i < n; i++) {
        at[r].with[i] -= AMB_C(0.5) * both[r][s] * at[s].moved[i];
      }
    }
  }
  for (int r = 0; r < count; r++) {
    int entry = 0;
    for (int i = 0; i < n; i++) {
      for (int j = i; j < n; j++) {
        P[entry] -= at[r].moved[i] * at[r].with[j] + at[r].with[i] * at[r].moved[j];
        entry++;
      }
    }
  }
}

static amb_status predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                          amb_kalman_result *result)
{
  const amb_kalman *kf = self->kf;
  const amb_contact *own = (const amb_contact *)self->own;
  amb_kalman_state *s = (amb_kalman_state *)state;
  amb_real iu[AMB_CONTROLS];
  amb_real F[AMB_FORCES];
  touching at[AMB_FORCES];
  amb_status status = amb_step_currents(kf, s, u, iu);
  amb_step_forces(kf, self->magnet, iu, s->mean, F, result->stiffness);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += kf->set.f_0[f];
  }
  const int count = touched(kf, own, s, F, at);
  for (int ring = 0; ring < count; ring++) {
    status |= AMB_CONTACT;
    add_force(&at[ring], F);
  }
  const amb_status predicted = amb_step_predict_with(kf, s, F, result->stiffness, iu);
  if ((predicted == AMB_OK) && (count > 0)) {
    stiffen(kf, count, at, result->stiffness, s->cov);
  }
  status |= amb_step_contain(kf, s);
  return status | predicted;
}

static void advance(const amb_estimator *self, amb_real scale, const amb_real iu[AMB_CONTROLS],
                    amb_real mean[AMB_STATES])
{
  const amb_kalman *kf = self->kf;
  amb_real F[AMB_FORCES];
  amb_real N[AMB_FORCES];
  (void)amb_contact_forces(self, mean, iu, scale, F, N);
  for (int f = 0; f < amb_forces(&kf->model); f++) {
    F[f] += N[f];
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
}

const amb_estimator_methods amb_contact_methods = {
    sizeof(amb_kalman_state), amb_plain_reset, predict, amb_plain_update, advance, NULL};
