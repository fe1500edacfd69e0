# In mount and process namespaces of its own, in the folder the program is to run in: runs program $2 with the arguments after
# it in the lab at $1. All that is mounted and started from here on ends with this shell.
lab=$1
program=$2
here=$PWD
cd "$lab"
mount -t tmpfs lab run
mkdir run/upper run/work run/root
# What a program writes into its Windows is gone with it: the lab stays as it was built.
mount -t overlay -o lowerdir=root,upperdir=run/upper,workdir=run/work lab run/root
cd run/root
mount -t proc proc proc
mount --rbind /dev dev
# The machine's own folders under their own names, so that a path means the same inside; the system's are the lab's.
for folder in /*; do
    case $folder in
    /bin | /sbin | /lib* | /usr | /etc | /var | /proc | /sys | /dev | /run | /boot | /lost+found | /windows) ;;
    *) if [ -d "$folder" ] && [ ! -L "$folder" ]; then
        mkdir -p ".$folder"
        mount --rbind "$folder" ".$folder"
    fi ;;
    esac
done
for folder in "$here" "${program%/*}" "$lab"; do
    case $folder in
    /*/*) if [ ! "$folder" -ef ".$folder" ]; then
        mkdir -p ".$folder"
        mount --bind "$folder" ".$folder"
    fi ;;
    esac
done
# Wine keeps its sockets there; another Wine of the machine must not be met. The folder stays afterwards: the kernel takes a
# mount away where its folder is removed, from other runs as well.
mkdir -p -m 700 tmp/.wine-0
mount -t tmpfs -o mode=700 lab tmp/.wine-0
exec chroot . sh -euc "$LAB_INSIDE" "$here" "$@"
