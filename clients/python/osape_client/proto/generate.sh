#!/bin/sh
# Writes osape_v1_pb2.py and osape_v1_pb2.pyi from osape_v1.proto (`make proto`). Run it from anywhere after each change of a field.
# The compiler is pinned, in an environment of its own: code from a newer one refuses older protobuf runtimes.
set -eu
root=$(cd "$(dirname "$0")/../../../.." && pwd)
environment="$root/build/proto-env"
"${PYTHON:-python3}" -m venv "$environment"
"$environment/bin/pip" install -q "grpcio-tools==1.76.0" setuptools
cd "$root/clients/python/osape_client/proto"
"$environment/bin/python" -m grpc_tools.protoc -I. --python_out=. --pyi_out=. osape_v1.proto
