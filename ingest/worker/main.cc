// fovea-worker: parses foreign files for the program that started it, and nothing else. It answers
// requests on its standard input, a socket, until the other end closes (docs/formats/worker.md).
// Nothing here is trusted by the program: a file that makes a parser crash takes only this down.

#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include <dlfcn.h>
#include <link.h>

#include "engine/base/buffers.h"
#include "ingest/channel.h"
#include "ingest/protocol.h"
#include "ingest/slab_ring.h"
#include "ingest/worker/dense_reader.h"
#include "ingest/worker/header_reader.h"
#include "ingest/worker/limits.h"
#include "ingest/worker/picture_encoder.h"
#include "ingest/worker/sandbox.h"
#include "ingest/worker/slice_reader.h"
#include "ingest/worker/vdb_reader.h"

namespace fovea::ingest {
namespace {

struct Settings {
  int64_t memory_bytes = 0;
  int64_t cpu_seconds = 120;  // for one request
  bool dies_with_thread = true;
};

Status Answer(const FrameView& request, Channel* channel) {
  switch (request.kind) {
    case FrameKind::kScan: {
      FOVEA_ASSIGN_OR_RETURN(const ScanRequest scan, DecodeScanRequest(request));
      FOVEA_ASSIGN_OR_RETURN(const FileFormat format, ChooseFormat(scan.paths, scan.hints));
      return format == FileFormat::kVdb       ? ScanVdb(scan, channel)
             : format == FileFormat::kPicture ? ScanSlices(scan, channel)
                                              : ScanDense(scan, format, channel);
    }
    case FrameKind::kRead: {
      FOVEA_ASSIGN_OR_RETURN(const ReadRequest read, DecodeReadRequest(request));
      FOVEA_ASSIGN_OR_RETURN(const FileFormat format, ChooseFormat(read.paths, read.hints));
      return format == FileFormat::kVdb       ? ReadVdb(read, channel)
             : format == FileFormat::kPicture ? ReadSlices(read, channel)
                                              : ReadDense(read, format, channel);
    }
    case FrameKind::kPicture: {
      FOVEA_ASSIGN_OR_RETURN(const PictureRequest picture, DecodePictureRequest(request));
      return EncodePicture(picture, channel);
    }
    default:
      return Internal("malformed message: not a request");
  }
}

/// The loaded library of that name, in whatever version; null: not loaded.
void* LoadedLibrary(const char* name) {
  std::pair<const char*, std::string> search{name, ""};
  ::dl_iterate_phdr(
      [](dl_phdr_info* info, size_t, void* context) {
        auto& [wanted, found] = *static_cast<std::pair<const char*, std::string>*>(context);
        if (std::strstr(info->dlpi_name, wanted) != nullptr) {
          found = info->dlpi_name;
        }
        return found.empty() ? 0 : 1;
      },
      &search);
  return search.second.empty() ? nullptr : ::dlopen(search.second.c_str(), RTLD_LAZY | RTLD_NOLOAD);
}

/// OpenVDB, as Debian builds it (OpenImageIO brings it along), logs through log4cplus, which starts
/// four threads when it is loaded and never uses them. The sandbox must come before any thread.
/// Looked up by name, because another build of OpenVDB has no log4cplus.
void StopLogThreads() {
  constexpr char kShutdownThreadPool[] = "_ZN9log4cplus18shutdownThreadPoolEv";
  void* library = LoadedLibrary("/liblog4cplus");
  void* symbol = library == nullptr ? nullptr : ::dlsym(library, kShutdownThreadPool);
  if (symbol != nullptr) {
    reinterpret_cast<void (*)()>(symbol)();
  }
}

/// Learns which files may be read, loads what reading them needs, and gives up all the rest.
StatusOr<Hello> Confined(Channel* channel) {
  Hello hello;
  std::vector<std::string> files;
  while (true) {
    FOVEA_ASSIGN_OR_RETURN(const FrameView frame, channel->Receive(Channel::kNoDeadline));
    if (frame.kind != FrameKind::kFiles) {
      FOVEA_ASSIGN_OR_RETURN(const BeginRequest begin, DecodeBeginRequest(frame));
      hello.openvdb = OpenVdbVersion();
      if (begin.pictures) {
        FOVEA_ASSIGN_OR_RETURN(hello.openimageio, LoadPictureModule());
      }
      break;
    }
    FOVEA_ASSIGN_OR_RETURN(const std::vector<std::string> more, DecodeFiles(frame));
    files.insert(files.end(), more.begin(), more.end());
  }
  StopLogThreads();
  FOVEA_ASSIGN_OR_RETURN(const Confinement confinement, Confine(files));
  hello.landlock_abi = static_cast<uint32_t>(confinement.landlock_abi);
  hello.system_calls_filtered = confinement.system_calls_filtered;
  return hello;
}

/// Answers requests until the other end closes.
Status Serve(const Settings& settings, Channel* channel) {
  const auto hello = Confined(channel);
  FOVEA_RETURN_IF_ERROR(channel->Send(hello.ok() ? Encode(*hello) : EncodeError(hello.status()),
                                      Channel::kNoDeadline));
  if (!hello.ok()) {
    FOVEA_RETURN_IF_ERROR(channel->Flush(Channel::kNoDeadline));
    return hello.status();
  }
  while (true) {
    FOVEA_RETURN_IF_ERROR(channel->Flush(Channel::kNoDeadline));
    const auto request = channel->Receive(Channel::kNoDeadline);
    if (absl::IsUnavailable(request.status())) {
      return absl::OkStatus();
    }
    FOVEA_RETURN_IF_ERROR(request.status());
    FOVEA_RETURN_IF_ERROR(LimitProcessorTime(settings.cpu_seconds));
    const Status answer = Answer(*request, channel);
    const Frame last = answer.ok() ? Frame{FrameKind::kEnd, ""} : EncodeError(answer);
    FOVEA_RETURN_IF_ERROR(channel->Send(last, Channel::kNoDeadline));
  }
}

bool ParseSettings(int argc, char** argv, Settings* settings) {
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    if (i + 1 == argc) {
      return false;
    }
    const int64_t value = std::atoll(argv[i + 1]);  // the program wrote it
    if (name == "--memory-bytes") {
      settings->memory_bytes = value;
    } else if (name == "--cpu-seconds") {
      settings->cpu_seconds = value;
    } else if (name == "--dies-with-thread") {
      settings->dies_with_thread = value != 0;
    } else {
      return false;
    }
  }
  return true;
}

int Main(int argc, char** argv) {
  Settings settings;
  struct stat input {};
  if (!ParseSettings(argc, argv, &settings) || ::fstat(STDIN_FILENO, &input) != 0 ||
      !S_ISSOCK(input.st_mode)) {
    std::fprintf(stderr, "fovea-worker reads files for fovea, which starts it by itself\n");
    return 2;
  }
  KeepFreedMemory();
  Channel channel(STDIN_FILENO);
  auto slabs = SlabRing::Adopt();
  Status status = slabs.status();
  if (status.ok()) {
    channel.Attach(std::move(*slabs));
    status = LimitProcess(settings.memory_bytes, settings.dies_with_thread);
  }
  if (status.ok()) {
    status = Serve(settings, &channel);
  }
  if (!status.ok()) {
    std::fprintf(stderr, "fovea-worker: %s\n", std::string(MessageOf(status)).c_str());
  }
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace fovea::ingest

// fovea-worker and fovea-vdb-worker differ in what they link as vdb_reader.h.
int main(int argc, char** argv) {
  return fovea::ingest::Main(argc, argv);
}
