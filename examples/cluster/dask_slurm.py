"""Runs `companion batch` on SLURM with dask-jobqueue (https://jobqueue.dask.org). Not run for this project.

The logs and the output are on a shared file system. The cluster runs while the command works. `cores=16, processes=16` gives
one thread to each worker. Where the time of a job ends, its flights are started again on other workers; where the whole job
ends, the same command continues."""

import subprocess

from dask_jobqueue import SLURMCluster

cluster = SLURMCluster(cores=16, processes=16, memory="16GB", walltime="04:00:00", job_extra_directives=["--nice=100"])
cluster.scale(jobs=8)
command = ["companion", "batch", "/shared/logs", "-o", "/shared/new", "--engine", "dask"]
subprocess.run([*command, "--address", cluster.scheduler_address], check=True)
