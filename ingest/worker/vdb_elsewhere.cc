#include "ingest/worker/vdb_reader.h"

// What fovea-worker has in place of OpenVDB.

namespace fovea::ingest {
namespace {

Status WrongName() {
  return FailedPrecondition(
      "it holds OpenVDB grids, but its name is that of another format; rename it to .vdb");
}

}  // namespace

Status ScanVdb(const ScanRequest& /*request*/, Channel* /*channel*/) {
  return WrongName();
}

Status ReadVdb(const ReadRequest& /*request*/, Channel* /*channel*/) {
  return WrongName();
}

std::string OpenVdbVersion() {
  return {};
}

}  // namespace fovea::ingest
