/* The ring of frames: their form, what is lost, and both sides over and over. */
#include "ambkit/crc.h"
#include "ambkit/telemetry.h"
#include "check.h"
#include <string.h>

#define NUMBERS 3
#define WORDS (NUMBERS + AMB_TELEMETRY_AROUND)
#define FRAMES 4

static const amb_real some[NUMBERS] = {AMB_C(1.0), AMB_C(-2.5), AMB_C(0.0)};

static void test_form(void)
{
  amb_telemetry ring;
  volatile uint32_t room[FRAMES * WORDS];
  uint32_t frame[WORDS];
  amb_telemetry_init(&ring, room, NUMBERS, FRAMES, 0x12345678U);
  CHECK(!amb_telemetry_take(&ring, frame));
  CHECK(amb_telemetry_put(&ring, 0x30041U, some));
  CHECK(amb_telemetry_take(&ring, frame));
  CHECK(memcmp(&frame[0], "AMBF", 4) == 0); /* on a machine that has the lowest byte first */
  CHECK(frame[1] == 0x12345678U && frame[2] == 0U && frame[3] == 0x30041U);
  CHECK(frame[4] == 0x3F800000U && frame[5] == 0xC0200000U && frame[6] == 0U);
  uint32_t crc = AMB_CRC_START;
  for (int i = 0; i < WORDS - 1; i++)
    crc = amb_crc_word(crc, frame[i]);
  CHECK(frame[WORDS - 1] == ~crc);
  CHECK(!amb_telemetry_take(&ring, frame));
}

static void test_full(void)
{
  amb_telemetry ring;
  volatile uint32_t room[FRAMES * WORDS];
  uint32_t frame[WORDS];
  amb_telemetry_init(&ring, room, NUMBERS, FRAMES, 1U);
  for (int k = 0; k < FRAMES; k++)
    CHECK(amb_telemetry_put(&ring, 0U, some));
  CHECK(!amb_telemetry_put(&ring, 0U, some));
  CHECK(amb_telemetry_take(&ring, frame) && frame[2] == 0U); /* the oldest one stays */
  CHECK(amb_telemetry_put(&ring, 0U, some));
  for (uint32_t k = 1; k < FRAMES; k++)
    CHECK(amb_telemetry_take(&ring, frame) && frame[2] == k);
  CHECK(amb_telemetry_take(&ring, frame) && frame[2] == FRAMES + 1U); /* one was lost */
}

/* Where the counters begin anew. */
static void test_wrap(void)
{
  amb_telemetry ring;
  volatile uint32_t room[FRAMES * WORDS];
  uint32_t frame[WORDS];
  amb_telemetry_init(&ring, room, NUMBERS, FRAMES, 1U);
  ring.written = ring.taken = ~0U - 2U;
  for (uint32_t k = 0; k < 20; k++) {
    const amb_real now[NUMBERS] = {(amb_real)k, AMB_C(0.0), AMB_C(0.0)};
    CHECK(amb_telemetry_put(&ring, k, now));
    if (k % 2 == 1) { /* two at a time */
      CHECK(amb_telemetry_take(&ring, frame) && frame[3] == k - 1);
      CHECK(amb_telemetry_take(&ring, frame) && frame[3] == k);
    }
  }
  CHECK(!amb_telemetry_take(&ring, frame));
}

int main(void)
{
  test_form();
  test_full();
  test_wrap();
  return failures;
}
