#!/usr/bin/env bash
# A Slurm of one machine, in a folder of its own and under the caller's name, for trying
# profiles/slurm. Needs Debian's or Ubuntu's slurm-wlm and munge; touches no Slurm that is there.
#
#   tests/slurm/cluster.sh start FOLDER [CPUS]    daemons up; prints what to evaluate in a shell
#   tests/slurm/cluster.sh stop FOLDER            daemons down
#
# Processes are not confined (no cgroups), memory is not limited, and there is no accounting
# database: sacct does not work, so Snakemake needs --slurm-status-command squeue. What ran, when
# and how it ended is in FOLDER/jobs.txt.
set -euo pipefail

usage="usage: $0 start FOLDER [CPUS] | stop FOLDER"
action=${1:?$usage}
mkdir -p "${2:?$usage}"
folder=$(cd "$2" && pwd)
cpus=${3:-$(nproc)}
export SLURM_CONF=$folder/slurm.conf
PATH=$PATH:/usr/sbin:/sbin

stop() {
    if [ -s "$folder/slurmctld.pid" ]; then
        scancel --user="$(id -un)" || true
        for _ in $(seq 100); do
            [ -z "$(squeue -h 2>/dev/null)" ] && break
            sleep 0.2
        done
    fi
    for daemon in slurmd slurmctld munged; do
        [ -s "$folder/$daemon.pid" ] || continue
        kill "$(cat "$folder/$daemon.pid")" 2>/dev/null || true
        for _ in $(seq 50); do
            kill -0 "$(cat "$folder/$daemon.pid" 2>/dev/null)" 2>/dev/null || break
            sleep 0.1
        done
        rm -f "$folder/$daemon.pid"
    done
}

start() {
    for program in munged slurmctld slurmd; do
        command -v $program >/dev/null || {
            echo "$program is missing: apt-get install slurm-wlm munge" >&2
            exit 1
        }
    done
    mkdir -p "$folder/state" "$folder/spool"
    memory=$(awk '/^MemTotal/ {print int(0.9 * $2 / 1024)}' /proc/meminfo) # MB
    chmod 755 "$folder"
    if [ ! -s "$folder/munge.key" ]; then
        (umask 077 && head -c 1024 /dev/urandom >"$folder/munge.key")
    fi
    cat >"$SLURM_CONF" <<EOF
ClusterName=local
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket=$folder/munge.socket
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/filetxt
JobCompLoc=$folder/jobs.txt
MinJobAge=600
KillWait=5
ReturnToService=2
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$memory State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES DefaultTime=10 MaxTime=600 State=UP
EOF
    # Within a job the executor plugin calls srun without SLURM_CONF.
    mkdir -p "$folder/bin"
    printf '#!/bin/sh\nSLURM_CONF=%s exec %s "$@"\n' "$SLURM_CONF" "$(command -v srun)" \
        >"$folder/bin/srun"
    chmod +x "$folder/bin/srun"
    munged --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
        --pid-file="$folder/munged.pid" --log-file="$folder/munged.log" \
        --seed-file="$folder/munged.seed"
    slurmctld
    slurmd
    for _ in $(seq 100); do
        [ "$(sinfo -h -o %T 2>/dev/null)" = idle ] && break
        sleep 0.2
    done
    if [ "$(sinfo -h -o %T)" != idle ]; then
        echo "Slurm's node is not idle; see $folder/slurmctld.log and slurmd.log" >&2
        stop
        exit 1
    fi
    echo "export SLURM_CONF=$SLURM_CONF PATH=$folder/bin:\$PATH"
}

case $action in
    start) start ;;
    stop) stop ;;
    *) echo "$usage" >&2; exit 2 ;;
esac
