#include "ambkit/telemetry.h"
#include "ambkit/crc.h"

/* A number and its bits; C99 permits reading either. */
typedef union single {
  float number;
  uint32_t bits;
} single;

void amb_telemetry_init(amb_telemetry *ring, volatile uint32_t words[], unsigned int numbers,
                        unsigned int frames, uint32_t layout)
{
  ring->words = words;
  ring->layout = layout;
  ring->count = 0U;
  ring->numbers = numbers;
  ring->frames = frames;
  ring->written = 0U;
  ring->taken = 0U;
}

/* Memory of frame k: the number of frames is a power of two, so this remains continuous where k
 * wraps to 0. */
static volatile uint32_t *place(const amb_telemetry *ring, unsigned int k)
{
  const unsigned int length = ring->numbers + (unsigned int)AMB_TELEMETRY_AROUND;
  return &ring->words[(k & (ring->frames - 1U)) * length];
}

bool amb_telemetry_put(amb_telemetry *ring, uint32_t flags, const amb_real numbers[])
{
  const unsigned int k = ring->written;
  const unsigned int taken = ring->taken;
  const uint32_t count = ring->count;
  ring->count = count + 1U;
  if ((k - taken) >= ring->frames) {
    return false;
  }
  volatile uint32_t *frame = place(ring, k);
  frame[0] = AMB_TELEMETRY_SYNC;
  frame[1] = ring->layout;
  frame[2] = count;
  frame[3] = flags;
  for (unsigned int i = 0; i < ring->numbers; i++) {
    single as;
    as.number = (float)numbers[i];
    frame[i + 4U] = as.bits;
  }
  ring->written = k + 1U; /* last: from here on it may be read */
  return true;
}

bool amb_telemetry_take(amb_telemetry *ring, uint32_t frame[])
{
  const unsigned int k = ring->taken;
  const unsigned int written = ring->written;
  if (k == written) {
    return false;
  }
  const volatile uint32_t *from = place(ring, k);
  const unsigned int last = ring->numbers + 4U;
  uint32_t crc = AMB_CRC_START;
  for (unsigned int i = 0; i < last; i++) {
    frame[i] = from[i];
    crc = amb_crc_word(crc, frame[i]);
  }
  frame[last] = ~crc;
  ring->taken = k + 1U; /* last: from here on it may be overwritten */
  return true;
}
