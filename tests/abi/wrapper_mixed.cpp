/*
 * include/cairn.hpp with exceptions and without in one program: this file, compiled once in each way. If both had functions of the same names,
 * the linker would keep one of them, and a failure in the part with exceptions would end the program.
 */
#include "cairn.hpp"

/* In the part without exceptions: the code of a failure. */
cairn_result code_without_exceptions();

#if CAIRN_HPP_EXCEPTIONS

static bool a_failure_is_thrown()
{
    try {
        (void)cairn::script::create("no script").value();
        return false;
    } catch (const cairn::error &e) {
        return e.code() == CAIRN_ERROR_INVALID_ARGUMENT && e.code() == code_without_exceptions();
    }
}

int main()
{
    const bool thrown = a_failure_is_thrown();
    std::printf("test a_failure_is_thrown_beside_code_without_exceptions ... %s\n", thrown ? "ok" : "FAILED");
    return thrown ? 0 : 1;
}

#else

cairn_result code_without_exceptions()
{
    const auto script = cairn::script::create("no script");
    if (script.ok()) (void)script.value();
    const auto valid = cairn::script::create("cairn-controls 1\n1 end\n");
    return valid.ok() && valid.value() ? script.code() : CAIRN_OK;
}

#endif
