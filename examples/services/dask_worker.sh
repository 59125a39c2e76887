#!/bin/sh
# A worker of a cluster for `mavhums fleet scan --scheduler`; scheduler and scan take the same certificates.
export DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION=True DASK_DISTRIBUTED__COMM__TLS__CA_FILE=ca.pem
export DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT=fleet.pem DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY=fleet-key.pem
export DASK_DISTRIBUTED__COMM__TLS__WORKER__CERT=fleet.pem DASK_DISTRIBUTED__COMM__TLS__WORKER__KEY=fleet-key.pem
export MALLOC_TRIM_THRESHOLD_=33554432 MALLOC_MMAP_THRESHOLD_=33554432
export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False
dask worker tls://10.0.0.1:8786 --nthreads 1
