/* A library with none or some of Cairn's functions: macros on the compiler's command line set the versions that it reports. */
#include <stdint.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

EXPORT int something_else(void);
EXPORT int something_else(void)
{
    return 1;
}

#ifdef STAND_IN_ABI
EXPORT uint32_t cairn_abi_version(void);
EXPORT uint32_t cairn_abi_version(void)
{
    return STAND_IN_ABI;
}
#endif

#ifdef STAND_IN_VERSION
EXPORT uint32_t cairn_version(void);
EXPORT uint32_t cairn_version(void)
{
    return STAND_IN_VERSION;
}
#endif
