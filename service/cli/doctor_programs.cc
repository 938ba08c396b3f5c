#include <string>

#include "ingest/program_path.h"
#include "ingest/worker/sandbox.h"
#include "ingest/worker_client.h"
#include "service/cli/doctor_checks.h"
#include "service/export/process.h"

namespace fovea::cli {
namespace {

constexpr int kLandlockOfTcp = 4;

Finding CheckLandlock(const ingest::Confinement& kernel, const std::string& problem) {
  if (kernel.landlock_abi >= kLandlockOfTcp) {
    return {"Landlock", fmt::format("ABI {}", kernel.landlock_abi), Verdict::kGood, ""};
  }
  if (kernel.landlock_abi > 0) {
    return {"Landlock", fmt::format("ABI {}, which does not know TCP", kernel.landlock_abi),
            kernel.system_calls_filtered ? Verdict::kGood : Verdict::kLacking,
            kernel.system_calls_filtered ? "" : "a kernel from 6.7 on knows it"};
  }
  return {
      "Landlock", "none: " + problem, Verdict::kLacking,
      "the worker can read every file that you can: ingest files that you trust only, or boot a "
      "kernel from 5.13 on with lsm=landlock,..."};
}

Finding CheckSeccomp(const ingest::Confinement& kernel) {
  if (kernel.system_calls_filtered) {
    return {"seccomp", "filters system calls", Verdict::kGood, ""};
  }
  return {"seccomp", "none", Verdict::kLacking,
          "the worker can reach the network and start programs: ingest files that you trust only, "
          "or use a kernel with CONFIG_SECCOMP_FILTER on x86-64 or arm64"};
}

/// What a worker says of itself that loads what such files need.
StatusOr<ingest::Hello> Greet(bool pictures, bool openvdb) {
  constexpr double kPatienceSeconds = 30;
  ingest::WorkerOptions options;
  options.limits.memory_bytes = 0;
  options.limits.seconds_per_file = kPatienceSeconds;
  options.pictures = pictures;
  options.openvdb = openvdb;
  return ingest::WorkerClient(options).Greet();
}

std::string InForce(const ingest::Hello& hello) {
  return fmt::format(
      "answers; confined by {} and {}",
      hello.landlock_abi > 0 ? fmt::format("Landlock {}", hello.landlock_abi) : "no Landlock",
      hello.system_calls_filtered ? "seccomp" : "no seccomp");
}

std::vector<Finding> CheckWorkers() {
  const StatusOr<ingest::Hello> plain = Greet(/*pictures=*/false, /*openvdb=*/false);
  if (!plain.ok()) {
    return {{"fovea-worker", std::string(MessageOf(plain.status())), Verdict::kMissing,
             "no foreign file can be read: put the program beside fovea, or name its folder in "
             "FOVEA_LIBEXEC"}};
  }
  std::vector<Finding> findings{{"fovea-worker", InForce(*plain), Verdict::kGood, ""}};
  const StatusOr<ingest::Hello> vdb = Greet(/*pictures=*/false, /*openvdb=*/true);
  findings.push_back(vdb.ok() ? Finding{"OpenVDB", vdb->openvdb, Verdict::kGood, ""}
                              : Finding{"OpenVDB", std::string(MessageOf(vdb.status())),
                                        Verdict::kLacking,
                                        "without it no VDB file can be read: put fovea-vdb-worker "
                                        "beside fovea-worker (Debian: apt-get install "
                                        "libopenvdb10.0)"});
  const StatusOr<ingest::Hello> pictures = Greet(/*pictures=*/true, /*openvdb=*/false);
  findings.push_back(pictures.ok()
                         ? Finding{"OpenImageIO", pictures->openimageio, Verdict::kGood, ""}
                         : Finding{"OpenImageIO", std::string(MessageOf(pictures.status())),
                                   Verdict::kLacking,
                                   "without it no EXR or TIFF can be read or written (Debian: "
                                   "apt-get install libopenimageio2.4)"});
  return findings;
}

Finding CheckProgram(const std::string& name, const std::string& who) {
  const StatusOr<std::string> path = ingest::FindProgram(name);
  if (path.ok()) {
    return {name, *path, Verdict::kGood, ""};
  }
  return {name, std::string(MessageOf(path.status())), Verdict::kMissing,
          who + " needs it: put it beside fovea"};
}

Finding CheckMovies() {
  const auto result = exports::RunProgram({"ffmpeg", "-version"});
  if (!result.ok() || result->exit_status != 0) {
    return {"ffmpeg", "not on the PATH", Verdict::kLacking,
            "movies need it (Debian: apt-get install ffmpeg); numbered pictures do not"};
  }
  // "ffmpeg version 5.1.6-0+deb12u1 Copyright ..."
  const std::string first = result->output.substr(0, result->output.find('\n'));
  const size_t begin = first.find("version ");
  const size_t end = first.find(" Copyright");
  return {"ffmpeg", begin == std::string::npos ? first : first.substr(begin + 8, end - begin - 8),
          Verdict::kGood, ""};
}

}  // namespace

std::vector<Finding> CheckPrograms() {
  std::string problem;
  const ingest::Confinement kernel = ingest::KernelConfinement(&problem);
  std::vector<Finding> findings{CheckLandlock(kernel, problem), CheckSeccomp(kernel)};
  for (Finding& finding : CheckWorkers()) {
    findings.push_back(std::move(finding));
  }
  findings.push_back(CheckProgram("fovead", "fovea serve"));
  findings.push_back(CheckProgram("fovea-remote", "fovea --server"));
  findings.push_back(CheckMovies());
  return findings;
}

}  // namespace fovea::cli
