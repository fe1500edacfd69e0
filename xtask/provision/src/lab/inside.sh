# Inside the lab, in folder $0: starts a display and runs a program in it.
unset LAB_INSIDE
shift
cd "$0"
mkfifo /run/display
# A folder in which others find what is on the display, as XWD.
Xvfb ${CAIRN_LAB_SCREEN:+-fbdir "$CAIRN_LAB_SCREEN"} -displayfd 3 -screen 0 1920x1080x24 -nolock -nolisten tcp -nolisten unix 3> /run/display > /run/xvfb.log 2>&1 < /dev/null &
if ! read -r display < /run/display; then
    cat /run/xvfb.log >&2
    echo "the lab's display does not start" >&2
    exit 1
fi
export DISPLAY=":$display" WINEPREFIX=/windows
# In another locale Wine reads only Latin letters in file names.
export LC_ALL="${LC_ALL:-C.UTF-8}"
# Wine's messages would mix with the program's output.
export WINEDEBUG="${WINEDEBUG:--all}" VKD3D_DEBUG="${VKD3D_DEBUG:-none}" VKD3D_SHADER_DEBUG="${VKD3D_SHADER_DEBUG:-none}"
export WINEDLLOVERRIDES="${WINEDLLOVERRIDES:-mscoree,mshtml=}"
export VK_DRIVER_FILES="${VK_DRIVER_FILES:-/usr/share/vulkan/icd.d/lvp_icd.json}"
# Windows starts by itself, so that its services and drivers do not speak through the program's streams; and it stays: none of
# them ends, and perhaps fails at it, while the program still speaks.
if ! { /usr/lib/wine/wineserver64 -p && /usr/lib/wine/wine64 hostname.exe; } > /run/windows.log 2>&1 < /dev/null; then
    cat /run/windows.log >&2
    echo "the lab's Windows does not start" >&2
    exit 1
fi
status=0
/usr/lib/wine/wine64 "$@" || status=$?
exit $status
