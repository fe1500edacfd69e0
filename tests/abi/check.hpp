/* Shared by the C++ programs of this folder: tests with the output of Rust's harness. */
#ifndef CAIRN_TEST_CHECK_HPP
#define CAIRN_TEST_CHECK_HPP

#include <cstdio>
#include <exception>

static int failed_checks;
static int failed_tests;

/* Prints a condition that does not hold, and continues. */
#define CHECK(what)                                                         \
    do {                                                                    \
        if (!(what)) {                                                      \
            std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #what); \
            failed_checks++;                                                \
        }                                                                   \
    } while (0)

/* Runs a test and prints its line. */
#define RUN(test) run_test(#test, test)

static void run_test(const char *name, void (*test)())
{
    failed_checks = 0;
#if CAIRN_HPP_EXCEPTIONS
    try {
        test();
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s: %s\n", name, e.what());
        failed_checks++;
    }
#else
    test();
#endif
    std::printf("test %s ... %s\n", name, failed_checks ? "FAILED" : "ok");
    std::fflush(stdout);
    failed_tests += failed_checks != 0;
}

#endif
