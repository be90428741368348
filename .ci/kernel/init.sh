#!/bin/busybox sh
# First process of the virtual machine: the host's files, read-only, below a file system in memory; then the tests.
b=/bin/busybox
$b mount -t proc proc /proc
$b mount -t sysfs sysfs /sys
$b mount -t devtmpfs devtmpfs /dev
for module in virtio_pci 9pnet_virtio 9p overlay; do
	$b modprobe $module
done
$b mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=512000,cache=loose host /lower
$b mount -t tmpfs -o mode=755 tmpfs /upper
$b mkdir /upper/data /upper/work
$b mount -t overlay -o lowerdir=/lower,upperdir=/upper/data,workdir=/upper/work overlay /new
for folder in proc sys dev; do
	$b mount --move /$folder /new/$folder
done
$b mkdir -p /new/dev/pts /new/dev/shm /new/results
$b mount -t devpts -o mode=620,ptmxmode=666 devpts /new/dev/pts
$b ln -sf pts/ptmx /new/dev/ptmx
$b mount -t tmpfs tmpfs /new/dev/shm
$b mount -t tmpfs tmpfs /new/tmp
$b mount -t tmpfs tmpfs /new/run
$b mount -t debugfs debugfs /new/sys/kernel/debug
$b mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000 results /new/results
$b ip link set lo up
$b chroot /new /bin/sh /results/inside.sh
echo $? >/new/results/exit_code
$b sync
$b poweroff -f
