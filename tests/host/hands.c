/* Simulates the user of a program in a window: presses W and moves the mouse until the program has recorded both, then presses Esc.
 *
 * usage: hands FILE PROGRAM [ARG...]
 *   FILE: the control script (docs/control-script.md) that the program records.
 * Exits with the program's exit status, or with 3 if the program did not record both.
 */
#define WIN32_LEAN_AND_MEAN
#include <windows.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Milliseconds between attempts, and in all. */
enum { PAUSE = 100, TIMEOUT = 10 * 60 * 1000 };

/* The command line of arguments that contain no quotes. */
static char *command_line(int count, char **arguments)
{
    size_t length = 1;
    for (int i = 0; i < count; i++) length += strlen(arguments[i]) + 3;
    char *line = calloc(length, 1);
    for (int i = 0; line && i < count; i++) {
        strcat(line, i > 0 ? " \"" : "\"");
        strcat(line, arguments[i]);
        strcat(line, "\"");
    }
    return line;
}

static void key(WORD code, int up)
{
    INPUT input = {.type = INPUT_KEYBOARD};
    input.ki.wVk = code;
    input.ki.wScan = (WORD)MapVirtualKeyA(code, MAPVK_VK_TO_VSC);
    input.ki.dwFlags = up ? KEYEVENTF_KEYUP : 0;
    SendInput(1, &input, sizeof input);
}

static void mouse(LONG right, LONG down)
{
    INPUT input = {.type = INPUT_MOUSE};
    input.mi.dx = right;
    input.mi.dy = down;
    input.mi.dwFlags = MOUSEEVENTF_MOVE;
    SendInput(1, &input, sizeof input);
}

/* Whether the control script has the key and a movement of the mouse. */
static int is_recorded(const char *path)
{
    static char text[1 << 16];
    FILE *file = fopen(path, "rb");
    if (!file) return 0;
    size_t length = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    text[length] = '\0';
    return strstr(text, " down W") && strstr(text, " mouse ");
}

int main(int count, char **arguments)
{
    if (count < 3) return 2;
    STARTUPINFOA start = {.cb = sizeof start};
    PROCESS_INFORMATION program;
    char *line = command_line(count - 2, arguments + 2);
    if (!line || !CreateProcessA(NULL, line, NULL, NULL, TRUE, 0, NULL, NULL, &start, &program)) {
        fprintf(stderr, "hands: %s does not start: error %lu\n", arguments[2], GetLastError());
        return 2;
    }
    int recorded = 0;
    DWORD start_time = GetTickCount();
    while (WaitForSingleObject(program.hProcess, PAUSE) == WAIT_TIMEOUT && GetTickCount() - start_time < TIMEOUT) {
        HWND window = FindWindowA("host-d3d12", NULL);
        if (!window || !IsWindowVisible(window)) continue;
        SetForegroundWindow(window);
        recorded = recorded || is_recorded(arguments[1]);
        if (recorded) {
            key('W', 1);
            key(VK_ESCAPE, 0);
            key(VK_ESCAPE, 1);
        } else {
            /* Repeated, as a held key is: the window may miss the first events. */
            key('W', 0);
            mouse(7, -3);
        }
    }
    DWORD status = STILL_ACTIVE;
    GetExitCodeProcess(program.hProcess, &status);
    if (status == STILL_ACTIVE) TerminateProcess(program.hProcess, 3);
    printf("hands: the program has %sheard of a key and of the mouse\n", recorded ? "" : "not ");
    return recorded && status != STILL_ACTIVE ? (int)status : 3;
}
