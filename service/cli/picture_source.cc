#include "service/cli/picture_source.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "ingest/sequence.h"
#include "ingest/step_reader.h"
#include "service/cli/console.h"

namespace fovea::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPartial = ".partial.zarr";

/// FNV-1a: a name for a file, not a secret.
uint64_t Hash(std::string_view text) {
  uint64_t hash = 14695981039346656037ULL;
  for (const char letter : text) {
    hash = (hash ^ static_cast<unsigned char>(letter)) * 1099511628211ULL;
  }
  return hash;
}

std::string HostName() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "localhost";
}

/// .NAME-HASH.HOST.PID.partial.zarr: says whose it is, so that others can tell when it is nobody's.
std::string PartialName(const std::string& name) {
  return fmt::format(".{}.{}.{}{}", name, HostName(), ::getpid(), kPartial);
}

/// Removes what killed ingests of this machine left in the cache.
void SweepPartials(const fs::path& cache) {
  std::error_code error;
  std::vector<fs::path> orphans;
  for (const auto& entry : fs::directory_iterator(cache, error)) {
    std::string name = entry.path().filename().string();
    if (!name.ends_with(kPartial)) {
      continue;
    }
    name.resize(name.size() - kPartial.size());
    const size_t dot = name.rfind('.');
    pid_t process = 0;
    const char* digits = name.data() + (dot == std::string::npos ? 0 : dot + 1);
    std::from_chars(digits, name.data() + name.size(), process);
    const bool of_this_host = dot != std::string::npos && name.substr(0, dot).ends_with(HostName());
    if (of_this_host && process > 0 && ::kill(process, 0) != 0 && errno == ESRCH) {
      orphans.push_back(entry.path());
    }
  }
  for (const fs::path& orphan : orphans) {
    fs::remove_all(orphan, error);
  }
}

StatusOr<std::string> IngestIntoCache(const PictureInput& input, const OutputOptions& output) {
  ingest::IngestOptions options = input.ingest;
  options.inputs = input.inputs;
  options.threads = input.threads;
  FOVEA_ASSIGN_OR_RETURN(const fs::path cache, CacheFolder(input.cache));
  FOVEA_ASSIGN_OR_RETURN(const std::string name, CacheName(options));
  const fs::path target = cache / (name + ".zarr");
  std::error_code error;
  if (fs::exists(target, error)) {
    Note(output, fmt::format("using the ingested copy {}", target.string()));
    return target.string();
  }
  fs::create_directories(cache, error);
  if (error) {
    return FailedPrecondition("--cache: cannot make the folder {}: {}", cache.string(),
                              error.message());
  }
  SweepPartials(cache);
  const fs::path partial = cache / PartialName(name);
  options.output = partial.string();
  Note(output,
       fmt::format("ingesting into the cache: {} (delete it whenever you like)", target.string()));
  Progress progress(output, "ingest", "steps");
  const auto report = ingest::Ingest(options, [&](const ingest::IngestProgress& now) {
    progress.Update(now.steps_done, now.steps_total, now.now);
    return !Interrupted();
  });
  if (!report.ok()) {
    fs::remove_all(partial, error);
    return report.status();
  }
  for (const std::string& warning : report->warnings) {
    Note(output, "note: " + warning);
  }
  fs::rename(partial, target, error);
  if (error) {
    // Another process may have finished the same dataset meanwhile: theirs is as good.
    std::error_code ignored;
    fs::remove_all(partial, ignored);
    if (!fs::exists(target, ignored)) {
      return FailedPrecondition("--cache: cannot make {}: {}", target.string(), error.message());
    }
  }
  return target.string();
}

}  // namespace

bool IsDataset(const std::string& path) {
  std::error_code error;
  fs::path folder(path);
  if (!folder.has_filename()) {
    folder = folder.parent_path();  // a trailing slash
  }
  return fs::is_directory(folder, error) &&
         (folder.extension() == ".zarr" || fs::exists(folder / "zarr.json", error));
}

bool NamesDataset(const std::vector<std::string>& inputs) {
  return inputs.size() == 1 && (IsDataset(inputs.front()) || inputs.front().ends_with(".zarr"));
}

StatusOr<std::string> CacheFolder(const std::string& given) {
  if (!given.empty()) {
    return given;
  }
  const auto variable = [](const char* name) -> std::optional<fs::path> {
    const char* value = std::getenv(name);
    return value != nullptr && *value == '/' ? std::optional<fs::path>(value) : std::nullopt;
  };
  if (const auto xdg = variable("XDG_CACHE_HOME")) {
    return (*xdg / "fovea").string();
  }
  if (const auto home = variable("HOME")) {
    return (*home / ".cache" / "fovea").string();
  }
  return FailedPrecondition(
      "neither XDG_CACHE_HOME nor HOME is set: name a folder for ingested files with --cache");
}

namespace {

/// The files of a series; those that headers name as well, so that the cache sees them change.
StatusOr<std::vector<ingest::SequenceFile>> AllFiles(const ingest::IngestOptions& options) {
  FOVEA_ASSIGN_OR_RETURN(auto files, ingest::ResolveInputs(options.inputs, options.on_missing));
  const auto is_header = [](const ingest::SequenceFile& file) {
    return file.path.ends_with(".nhdr") || file.path.ends_with(".mhd") ||
           file.path.ends_with(".hdr") || file.path.ends_with(".hdr.gz");
  };
  if (!options.raw && std::any_of(files.begin(), files.end(), is_header)) {
    ingest::Workers workers;
    const auto go_on = [](const std::string&) { return true; };
    FOVEA_ASSIGN_OR_RETURN(
        const auto scanned,
        ingest::ScanFiles(options, files, /*from_voxels=*/false, go_on, &workers));
    for (size_t i = 0; i < files.size(); ++i) {
      files[i] = scanned[i].file;
    }
  }
  return files;
}

}  // namespace

StatusOr<std::string> CacheName(const ingest::IngestOptions& options) {
  FOVEA_ASSIGN_OR_RETURN(const auto files, AllFiles(options));
  std::string key = fmt::format("1 {} {} {}", static_cast<int>(options.on_missing),
                                static_cast<int>(options.registration), options.field);
  for (const std::string& grid : options.grids) {
    key += fmt::format("\ngrid {}", grid);
  }
  if (options.raw) {
    const ingest::RawFormat& raw = *options.raw;
    key += fmt::format("\nraw {} {} {} {} {} {} {}", raw.dims.x, raw.dims.y, raw.dims.z, raw.type,
                       raw.big_endian, raw.header_bytes, raw.steps_per_file);
  }
  if (const auto& spacing = options.spacing) {
    key += fmt::format("\nspacing {} {} {}", spacing->x, spacing->y, spacing->z);
  }
  key += fmt::format("\n'{}' '{}' {}", options.channel, options.axes, options.slices_per_step);
  for (const ingest::SequenceFile& file : files) {
    for (const std::string& path : file.Paths()) {
      std::error_code error;
      struct stat info {};
      if (::stat(path.c_str(), &info) != 0) {
        return NotFound("cannot read {}: {}", path, std::generic_category().message(errno));
      }
      key += fmt::format("\n{} {} {}.{:09} {}", fs::absolute(path, error).string(), info.st_size,
                         info.st_mtim.tv_sec, info.st_mtim.tv_nsec, file.held);
    }
  }
  std::string stem = files.front().path;
  stem = fs::path(stem).stem().string();
  stem.resize(stem.find_last_not_of("0123456789_.-") + 1);
  return fmt::format("{}-{:016x}", stem.empty() ? "volume" : stem, Hash(key));
}

StatusOr<std::unique_ptr<exports::FrameProvider>> OpenPictures(const PictureInput& input,
                                                               const OutputOptions& output) {
  if (input.server) {
    const auto transport = input.local      ? exports::Transport::kCoefficients
                           : input.foveated ? exports::Transport::kFoveated
                                            : exports::Transport::kPictures;
    return exports::OpenRemote(*input.server, input.credentials, input.inputs.front(), transport,
                               input.threads);
  }
  if (NamesDataset(input.inputs)) {
    return exports::OpenLocal(input.inputs.front(), input.threads);
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string path, IngestIntoCache(input, output));
  return exports::OpenLocal(path, input.threads);
}

}  // namespace fovea::cli
