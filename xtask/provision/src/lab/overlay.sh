# In mount and process namespaces of its own, in the folder of the lab at $1: its Debian is in run/root, and what is written there is gone
# with the namespaces, so that the lab stays as it is. A script that copies something into the folder $2 follows.
cd "$1"
mount -t tmpfs lab run
mkdir run/upper run/work run/root
mount -t overlay -o lowerdir=root,upperdir=run/upper,workdir=run/work lab run/root
mount -t proc proc run/root/proc
mount --rbind /dev run/root/dev
