/*
 * Replaces the program `scenes` where that is not built for Windows: writes its arguments to the file that CAIRN_TEST_ARGUMENTS names,
 * one per line, and then the contents of the file that CAIRN_TEST_PICTURES names to standard output.
 */
#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#endif

int main(int count, char **arguments)
{
    const char *const list = getenv("CAIRN_TEST_ARGUMENTS"), *const pictures = getenv("CAIRN_TEST_PICTURES");
    FILE *const to = list ? fopen(list, "wb") : NULL, *const from = pictures ? fopen(pictures, "rb") : NULL;
    if (!to || !from) {
        fprintf(stderr, "renderer: CAIRN_TEST_ARGUMENTS or CAIRN_TEST_PICTURES names no file\n");
        return 2;
    }
    for (int i = 1; i < count; i++) fprintf(to, "%s\n", arguments[i]);
    fclose(to);
#ifdef _WIN32
    _setmode(_fileno(stdout), _O_BINARY);
#endif
    char bytes[4096];
    size_t length;
    while ((length = fread(bytes, 1, sizeof bytes, from)) > 0) fwrite(bytes, 1, length, stdout);
    return ferror(from) || fflush(stdout) != 0;
}
