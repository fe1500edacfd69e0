/* Seeded call sequences over the whole interface, with random structs and a world. */
#include "play.h"

static void random_calls_break_nothing(void)
{
    enum { SEQUENCES = 60, LENGTH = 1500 };
    unsigned long count = getenv("CAIRN_THOROUGH") ? 100 * SEQUENCES : SEQUENCES;
    create_objects(make_device());
    uint64_t state = 0x9e3779b97f4a7c15ull;
    for (unsigned long i = 0; i < count; i++) {
        static unsigned char choices[LENGTH];
        for (int at = 0; at < LENGTH; at++) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            choices[at] = (unsigned char)(state >> 24);
        }
        struct bytes from = {choices, LENGTH};
        play(&from);
        /* Cancels queued steps, so that the next sequence starts with the same objects. */
        OK(cairn_rollout_cancel(objects[QUEUE]));
        OK(cairn_rollout_pause(objects[QUEUE]));
    }
    /* After all sequences a rollout still gives the usual result. */
    cairn_controls c = controls(1);
    OK(cairn_rollout_restore(objects[ROLLOUT], saved_state, saved_size));
    OK(cairn_rollout_step(objects[ROLLOUT], &c, NULL));
    destroy_objects();
}

int main(void)
{
    RUN(random_calls_break_nothing);
    return failed_tests != 0;
}
