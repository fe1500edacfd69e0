/* Plays bytes as calls of the C interface, for the target of that name. */
#include "../tests/abi/play.h"

void cairn_fuzz_calls(const unsigned char *bytes, size_t size);

/* Without a world all objects that need none are there; their sequences are short, so that more of them are played. */
static void make_stage(void)
{
    if (getenv("CAIRN_TEST_WORLD")) {
        set_stage(make_device());
    } else {
        objects[ANCHOR] = made_anchor(7);
        make_small();
    }
}

void cairn_fuzz_calls(const unsigned char *bytes, size_t size)
{
    static int ready;
    if (!ready) make_stage();
    ready = 1;
    struct bytes from = {bytes, size};
    play(&from);
    if (objects[QUEUE]) {
        OK(cairn_rollout_cancel(objects[QUEUE]));
        OK(cairn_rollout_pause(objects[QUEUE]));
    }
    if (failed_checks) abort();
}
