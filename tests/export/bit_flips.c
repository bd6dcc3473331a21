/* Flips each bit of what an export keeps in RAM, one in each flight, in a loop that hovers, and
 * flies on. The rotor is the export's own model, so truth is known. Compiled against one export;
 * the including file says how it is stepped:
 *
 *   outcome                         whether the estimate is fed back, whether it flies, its status
 *   NAME_STATE                    type of all that lies in RAM; its amb_kalman_state is FILTER(s)
 *   KF, MAGNETS or STIFFNESS      constants
 *   outside                       type of what the loop has beside it
 *   begin(s), step(s, o, y, iu)   one sample: writes the currents, returns what is to be known
 *
 * A flight ends where all that lies in RAM is again what it is in the flight without a flip; or is
 * so for long but for the flipped bits, which nothing reads.
 *
 * Prints one line for each flight that came to harm, and a line of totals. */
#include <setjmp.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void begin(NAME_STATE *s);
static outcome step(NAME_STATE *s, outside *o, const amb_real y[AMB_SENSORS],
                    amb_real iu[AMB_CONTROLS]);

typedef struct loop {
  NAME_STATE s;
  outside o;
  amb_real X[AMB_STATES]; /* the rotor */
  amb_real iu[AMB_CONTROLS];
  uint64_t seed;
} loop;

static amb_real uniform(uint64_t *seed)
{
  *seed = *seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
  return (amb_real)(((double)(*seed >> 11) / 9007199254740992.0) - 0.5);
}

static amb_real gaussian(uint64_t *seed)
{
  amb_real sum = 0;
  for (int i = 0; i < 12; i++)
    sum += uniform(seed);
  return sum;
}

static amb_real deviation[AMB_SENSORS]; /* of the sensors' noise [m] */

static void find_deviations(void)
{
  for (int r = 0; r < amb_sensors(&KF.model); r++) {
    amb_real root = KF.set.var_y[r];
    for (int i = 0; i < 60; i++) /* Heron, from above */
      root = (amb_real)0.5 * (root + KF.set.var_y[r] / root);
    deviation[r] = root;
  }
}

/* One sample of the loop. Returns how far the farthest position is off [caps]. */
static amb_real fly(loop *l, outcome *h, bool *touched)
{
  const amb_model *model = &KF.model;
  amb_real F[AMB_FORCES], y[AMB_SENSORS];
  for (int f = 0; f < amb_forces(model); f++) {
    const amb_real i = amb_model_current(model, f, l->X, l->iu);
    const amb_real at = amb_model_displacement(model, f, l->X);
#if defined(STIFFNESS)
    const amb_stiffness k = STIFFNESS;
#else
    const amb_stiffness k = MAGNETS[f].methods->through_origin(
        MAGNETS[f].self, i, amb_clamp(at, -KF.set.x_max[f], KF.set.x_max[f]));
#endif
    F[f] = k.k_i * i + k.k_s * at + KF.set.f_0[f];
  }
  amb_model_predict_mean(model, F, l->iu, l->X);
  for (int i = 0; i < amb_states(model); i++)
    if (amb_model_role(model, i) == AMB_POSITION && amb_magnitude(l->X[i]) > KF.set.cap[i]) {
      l->X[i] = amb_clamp(l->X[i], -KF.set.cap[i], KF.set.cap[i]);
      *touched = true;
      for (int j = 0; j < amb_states(model); j++)
        if (amb_model_role(model, j) == AMB_VELOCITY)
          l->X[j] = 0;
    }
  for (int r = 0; r < amb_sensors(model); r++)
    y[r] = amb_model_shown(model, r, l->X) + (amb_real)NOISE * deviation[r] * gaussian(&l->seed);
  *h = step(&l->s, &l->o, y, l->iu);
  amb_real worst = 0;
  for (int i = 0; i < amb_states(model); i++)
    if (amb_model_role(model, i) == AMB_POSITION) {
      const amb_real off = amb_magnitude(FILTER(&l->s)->mean[i] - l->X[i]) / KF.set.cap[i];
      worst = off <= worst ? worst : off; /* also where it is no number */
    }
  return worst;
}

#if defined(DRAWS)
/* Sets of numbers on stdin, one after the other in one flight, each flown for so many samples.
 * Prints of each what was refused, whether it flies, and whether the rotor has touched a stop. */
int main(int argc, char **argv)
{
  static loop now;
  const int each = argc > 1 ? atoi(argv[1]) : 1500;
  outcome h = {false, false, 0};
  bool touched = false;
  double number;
  begin(&now.s);
  find_deviations();
  for (int k = 0; k < each; k++)
    (void)fly(&now, &h, &touched);
  for (;;) {
    const amb_calibration *cal = &now.s.cal;
    for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
      if (scanf("%lf", &number) != 1)
        return 0;
      now.s.cal.wanted[n] = (amb_real)number;
    }
    now.s.cal.request++;
    touched = false;
    for (int k = 0; k < each; k++)
      (void)fly(&now, &h, &touched);
    bool taken = true;
    for (int n = 0; n < (int)AMB_PARAMETERS; n++)
      taken = taken && cal->in_use[n] == cal->wanted[n];
    printf("%u %d %d %d\n", (unsigned)cal->refused, taken, h.up, touched);
  }
}
#else
enum { EACH = 8, LONG = 600 }; /* samples between two looks at the memory, and until one is long */

static sigjmp_buf out_of;

static void caught(int number)
{
  siglongjmp(out_of, number);
}

/* The bits of one flight: the given one, and so many more at random, in its word or anywhere. */
static size_t choose(size_t bit, size_t many, size_t size, size_t bits[])
{
  uint64_t seed = bit + 1;
  const size_t count =
      many > 1 ? 2 + (size_t)((double)(many - 1) * ((double)uniform(&seed) + 0.5)) : 1;
  const bool close = uniform(&seed) > 0;
  const size_t from = close ? bit / 64 * 64 : 0, room = close ? 64 : size;
  bits[0] = bit;
  for (size_t b = 1; b < count; b++)
    bits[b] = (from + (size_t)((double)room * ((double)uniform(&seed) + 0.5))) % size;
  return count;
}

static void flip(unsigned char *bytes, size_t count, const size_t bits[])
{
  for (size_t b = 0; b < count; b++)
    bytes[bits[b] / 8] ^= (unsigned char)(1U << (bits[b] % 8));
}

/* Whether the loop is what it is without a flip; from `LONG` on, but for the flipped bits. */
static bool as_without(const loop *l, const loop *without, int k, size_t count, const size_t bits[])
{
  static loop other;
  if (memcmp(l, without, sizeof *l) == 0)
    return true;
  if (k < LONG)
    return false;
  memcpy(&other, l, sizeof other);
  flip((unsigned char *)&other.s, count, bits);
  return memcmp(&other, without, sizeof other) == 0;
}

/* Arguments: samples before the flip, after it, until it is settled; one of how many bits, which is
 * the first; the most bits of a flight. */
int main(int argc, char **argv)
{
  enum { MANY = 64 };
  static loop start, now;
  if (argc < 7)
    return 2;
  const int before = atoi(argv[1]), after = atoi(argv[2]), settling = atoi(argv[3]);
  const size_t every = (size_t)atoi(argv[4]), first = (size_t)atoi(argv[5]);
  const size_t many = (size_t)atoi(argv[6]), size = 8 * sizeof start.s;
  loop *without = malloc(((size_t)after / EACH + 1) * sizeof *without);
  outcome h = {false, false, 0};
  bool touched = false;
  if (without == NULL || many > MANY)
    return 2;
  memset(&start, 0, sizeof start);
  start.seed = 1;
  for (int i = 0; i < AMB_STATES; i++)
    start.X[i] = amb_model_role(&KF.model, i) == AMB_LOAD ? (amb_real)LOAD : 0;
  begin(&start.s);
  find_deviations();
  for (int k = 0; k < before; k++)
    (void)fly(&start, &h, &touched);
  amb_real healthy = 0;
  amb_status flags = 0;
  int unfed = 0;
  touched = false;
  memcpy(&now, &start, sizeof now);
  for (int k = 0; k < after; k++) {
    const amb_real off = fly(&now, &h, &touched);
    healthy = off > healthy ? off : healthy;
    flags |= h.status;
    unfed += !h.fed;
    if (k % EACH == EACH - 1)
      memcpy(&without[k / EACH], &now, sizeof now);
  }
  printf("healthy %g flags %u unfed %d touched %d\n", (double)healthy, flags, unfed, touched);
  const amb_real wrong = 4 * healthy;
  long flips = 0, stuck = 0, badly = 0, crashed = 0, landed = 0, said = 0;
  int slowest = 0;
  for (int number = 1; number < 32; number++)
    if (number == SIGSEGV || number == SIGBUS || number == SIGFPE || number == SIGALRM ||
        number == SIGABRT)
      signal(number, caught);
  for (size_t bit = first; bit < size; bit += every) {
    size_t bits[MANY];
    const size_t count = choose(bit, many, size, bits);
    int longest = 0, in_a_row = 0, down = 0, unused = 0, flagged = 0;
    amb_real most = 0;
    touched = false;
    flips++;
    memcpy(&now, &start, sizeof now);
    flip((unsigned char *)&now.s, count, bits);
    const int number = sigsetjmp(out_of, 1);
    if (number == 0) {
      alarm(20);
      for (int k = 0; k < after; k++) {
        const amb_real off = fly(&now, &h, &touched);
        const bool bad = h.fed && !(off <= wrong);
        in_a_row = bad ? in_a_row + 1 : 0;
        longest = in_a_row > longest ? in_a_row : longest;
        most = bad && k > settling && off > most ? off : most;
        down = h.up ? 0 : down + 1;
        unused = h.fed ? 0 : unused + 1;
        flagged = (h.status & ~flags) ? flagged + 1 : 0;
        if (k % EACH == EACH - 1 && as_without(&now, &without[k / EACH], k, count, bits))
          break;
      }
      alarm(0);
    } else {
      crashed++;
    }
    stuck += down > settling || unused > settling;
    badly += longest > settling;
    landed += touched;
    said += flagged > settling;
    slowest = longest > slowest ? longest : slowest;
    if (number || down > settling || unused > settling || longest > settling || flagged > settling)
      printf("bit %zu of byte %zu, %zu bits: signal %d, wrong for %d by %g caps, down %d, unused "
             "%d, flagged %d (%u)\n",
             bit % 8, bit / 8, count, number, longest, (double)most, down, unused, flagged,
             h.status);
  }
  printf("total %ld flips, %ld stuck, %ld fed back wrong, %ld crashed, %ld flagged, %ld touched, "
         "wrong for %d at most\n",
         flips, stuck, badly, crashed, said, landed, slowest);
  return 0;
}
#endif
