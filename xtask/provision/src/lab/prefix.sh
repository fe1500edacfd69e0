# Inside the lab's Debian: a Windows as Wine makes it, in /windows.
rm -rf /windows
export WINEPREFIX=/windows WINEDEBUG=-all WINEDLLOVERRIDES=mscoree,mshtml= HOME=/root
/usr/lib/wine/wine64 wineboot -i
# A program that crashes ends with a status; nobody is there to answer a dialog.
/usr/lib/wine/wine64 reg add 'HKCU\Software\Wine\WineDbg' /v ShowCrashDialog /t REG_DWORD /d 0 /f
/usr/lib/wine/wineserver64 -w
cmp "$(find /usr/lib -path '*wine/x86_64-windows/wined3d.dll')" /windows/drive_c/windows/system32/wined3d.dll
rm -rf /var/lib/apt/lists/* /var/cache/apt/*.bin
