/* Control scripts and recordings of live input. */
#include <stdint.h>

#include "check.h"

static const char walk[] = "cairn-controls 1\n# Walk, look right.\n0..1 hold W\n0.5..1 mouse 150 0\n1.5 scroll 2\n2 end\n";

static cairn_controls of_step(cairn_script *script, uint64_t latent)
{
    cairn_controls c = {.struct_size = sizeof c};
    OK(cairn_script_get_controls(script, latent, 15, &c));
    return c;
}

static void a_script_gives_the_controls_of_each_step(void)
{
    cairn_script *script = NULL;
    OK(cairn_script_create(walk, sizeof walk - 1, &script));
    uint64_t duration = 0;
    OK(cairn_script_get_duration(script, &duration));
    CHECK(duration == 2000000);
    double dx = 0;
    for (uint64_t latent = 0; latent <= 40; latent++) {
        cairn_controls c = of_step(script, latent);
        dx += c.mouse_dx;
        CHECK((c.keys[1] == 1ull << 23) == (latent >= 1 && latent <= 15));
        CHECK((c.scroll == 1) == (latent == 23));
    }
    CHECK(dx > 149.999 && dx < 150.001);
    OK(cairn_script_destroy(script));
}

static void invalid_scripts_are_refused_with_their_line(void)
{
    cairn_script *script = NULL;
    static const char wrong[] = "cairn-controls 1\n0 up W\n", newer[] = "cairn-controls 2\n", binary[] = "cairn-controls 1\n\xff\n";
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_create(wrong, sizeof wrong - 1, &script));
    CHECK(strstr(message(), "line 2") != NULL);
    ANSWERS(CAIRN_ERROR_UNSUPPORTED, cairn_script_create(newer, sizeof newer - 1, &script));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_script_create(binary, sizeof binary - 1, &script));
    CHECK(script == NULL);
}

/* A script's text; to be freed by the caller. */
static char *text_of(cairn_script *script)
{
    size_t length = 0;
    OK(cairn_script_get_text(script, NULL, 0, &length));
    char *text = malloc(length + 1);
    OK(cairn_script_get_text(script, text, length + 1, NULL));
    CHECK(strlen(text) == length);
    return text;
}

static void recorded_steps_play_again_bit_for_bit(void)
{
    cairn_recorder *recorder = NULL;
    cairn_script *script = NULL, *again = NULL;
    OK(cairn_recorder_create(&recorder));
    enum { STEPS = 50 };
    cairn_controls given[STEPS + 1];
    for (int i = 1; i <= STEPS; i++) {
        given[i] = controls(i * 7 % 23);
        given[i].mouse_dx *= 1.1f;
        given[i].scroll = (float)(i % 3 - 1);
        OK(cairn_recorder_step(recorder, (uint64_t)i, 15, &given[i]));
    }
    OK(cairn_recorder_make_script(recorder, 4000000, &script));
    char *text = text_of(script);
    OK(cairn_script_create(text, strlen(text), &again));
    for (int i = 1; i <= STEPS; i++) {
        cairn_controls c = of_step(again, (uint64_t)i);
        CHECK(memcmp(&c, &given[i], sizeof c) == 0);
    }
    free(text);
    OK(cairn_script_destroy(script));
    OK(cairn_script_destroy(again));
    OK(cairn_recorder_destroy(recorder));
}

static void live_events_are_recorded_as_a_script(void)
{
    cairn_recorder *recorder = NULL;
    cairn_script *script = NULL;
    OK(cairn_recorder_create(&recorder));
    OK(cairn_recorder_key(recorder, 100000, 'W', 1));
    OK(cairn_recorder_key(recorder, 150000, 'W', 1)); /* keyboards repeat */
    OK(cairn_recorder_mouse(recorder, 200000, 5, -2.5f));
    OK(cairn_recorder_scroll(recorder, 250000, -1));
    OK(cairn_recorder_key(recorder, 300000, 'W', 0));
    OK(cairn_recorder_key(recorder, 400000, 0x20, 1));
    ANSWERS(CAIRN_ERROR_INVALID_ARGUMENT, cairn_recorder_make_script(recorder, 350000, &script));
    OK(cairn_recorder_make_script(recorder, 500000, &script));
    char *text = text_of(script);
    CHECK(strcmp(text, "cairn-controls 1\n0.1 down W\n0.2 mouse 5 -2.5\n0.25 scroll -1\n0.3 up W\n"
                       "0.4 down SPACE\n0.5 up SPACE\n0.5 end\n") == 0);
    free(text);
    OK(cairn_script_destroy(script));
    OK(cairn_recorder_destroy(recorder));
}

int main(void)
{
    RUN(a_script_gives_the_controls_of_each_step);
    RUN(invalid_scripts_are_refused_with_their_line);
    RUN(recorded_steps_play_again_bit_for_bit);
    RUN(live_events_are_recorded_as_a_script);
    return failed_tests != 0;
}
