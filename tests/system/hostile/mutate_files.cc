// Sends mutated files through the real worker, as ingest does: scan, then read what the scan found.
//
//   mutate_files COUNT SEED FILE...     FILE: a seed; .raw ones need their name to be
//                                       NAME.NXxNYxNZ-TYPE.raw
//
// Each file has workers of its own, as in an ingest of one file; but pictures come in groups, as in
// an ingest of a sequence: one worker scans and reads all files of a group, and is replaced where
// it dies or is stopped. Loading OpenImageIO takes a hundred times as long as reading a small
// picture.
//
// Prints one line of numbers for each seed, and ends with 1 if a file was refused without an error
// that names it, or anything took longer than its deadline.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "ingest/dense_field.h"
#include "ingest/file_format.h"
#include "ingest/ingest.h"
#include "ingest/sequence.h"
#include "ingest/series_plan.h"
#include "ingest/step_reader.h"
#include "ingest/worker_client.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;

constexpr double kSecondsPerFile = 5;
/// Past the deadline a worker is killed and reaped; on a loaded machine that takes a while.
constexpr double kPatienceSeconds = 5;
constexpr int64_t kWorkerMemoryBytes = int64_t{1} << 30;

std::string ReadWhole(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

using Random = std::mt19937_64;

size_t Below(size_t limit, Random* random) {
  return limit == 0 ? 0 : static_cast<size_t>((*random)() % limit);
}

/// A place in the file: mostly near its start, where headers are.
size_t Place(size_t size, Random* random) {
  const size_t head = std::min<size_t>(size, 2048);
  return Below(Below(3, random) == 0 ? size : head, random);
}

void MutateOnce(std::string* bytes, Random* random) {
  static constexpr int64_t kOdd[] = {0, -1, 1, 0x7FFFFFFF, -0x80000000LL, 0x7FFFFFFFFFFFFFFF, 255};
  const size_t at = Place(bytes->size(), random);
  switch (Below(7, random)) {
    case 0:  // a bit
      if (!bytes->empty()) {
        (*bytes)[at] = static_cast<char>((*bytes)[at] ^ (1 << Below(8, random)));
      }
      break;
    case 1:  // a byte
      if (!bytes->empty()) {
        (*bytes)[at] = static_cast<char>((*random)());
      }
      break;
    case 2: {  // a number that breaks sizes
      const int64_t value = kOdd[Below(std::size(kOdd), random)];
      const size_t width = size_t{1} << Below(4, random);
      if (at + width <= bytes->size()) {
        bytes->replace(at, width, reinterpret_cast<const char*>(&value), width);
      }
      break;
    }
    case 3:  // cut short
      bytes->resize(Below(2, random) == 0 ? at : Below(bytes->size() + 1, random));
      break;
    case 4:  // a piece is gone
      bytes->erase(at, Below(64, random));
      break;
    case 5:  // a piece is there twice
      bytes->insert(at, bytes->substr(at, Below(256, random)));
      break;
    default:  // digits of a text header
      for (size_t i = at; i < std::min(at + 64, bytes->size()); ++i) {
        if ((*bytes)[i] >= '0' && (*bytes)[i] <= '9') {
          (*bytes)[i] = static_cast<char>('0' + Below(10, random));
        }
      }
  }
}

struct Tally {
  int64_t files = 0;
  int64_t read = 0;
  int64_t refused = 0;
  int64_t died = 0;      // of them: the worker died of a signal
  int64_t too_long = 0;  // of them: stopped at a deadline
  int64_t wrong = 0;     // unnamed error, or past the deadline
  double longest_s = 0;
};

/// Scans, plans and reads one file.
Status Take(const IngestOptions& options, const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<SequenceFile> files,
                         ResolveInputs({path}, OnMissing::kError));
  Workers workers;
  const auto go_on = [](const std::string&) { return true; };
  FOVEA_ASSIGN_OR_RETURN(const std::vector<ScannedFile> scanned,
                         ScanFiles(options, files, false, go_on, &workers));
  FOVEA_ASSIGN_OR_RETURN(const SeriesPlan plan, PlanSeries(options, scanned, std::nullopt));
  StepReader reader(options, plan, std::move(workers));
  for (size_t step = 0; step < plan.steps.size(); ++step) {
    FOVEA_RETURN_IF_ERROR(reader.Next().status());
  }
  return absl::OkStatus();
}

/// The same for a picture, with the worker that is there.
Status TakePicture(const IngestOptions& options, const std::string& path, WorkerClient* client) {
  ScannedFile scanned{{path, std::nullopt}, {}, {}};
  const Frame scan = Encode(ScanRequest{{path}, {}, false});
  FOVEA_RETURN_IF_ERROR(client->Call(path, scan, {}, [&](const FrameView& reply) -> Status {
    if (reply.kind == FrameKind::kFile) {
      FOVEA_ASSIGN_OR_RETURN(scanned.info, DecodeFileInfo(reply));
      return absl::OkStatus();
    }
    FOVEA_ASSIGN_OR_RETURN(GridInfo grid, DecodeGridInfo(reply));
    scanned.grids.push_back(std::move(grid));
    return absl::OkStatus();
  }));
  FOVEA_ASSIGN_OR_RETURN(const SeriesPlan plan, PlanSeries(options, {scanned}, std::nullopt));
  for (const PlannedStep& step : plan.steps) {
    DenseField field(plan.extent, 2 * options.chunk_edge, kWorkerMemoryBytes);
    const Frame read = Encode(ReadRequest{
        {path}, {}, step.sources.front().step_in_file, plan.extent, {""}, plan.lattice});
    FOVEA_RETURN_IF_ERROR(client->Call(path, read, {}, [&](const FrameView& reply) {
      return field.Consume(reply, client->slabs(),
                           [](const DenseSlices&) { return absl::OkStatus(); });
    }));
    FOVEA_RETURN_IF_ERROR(Annotate(field.Finish().status(), path));
  }
  return absl::OkStatus();
}

/// Headerless voxels tell their format in their name.
std::optional<RawFormat> FormatOf(const std::string& seed) {
  const fs::path name = fs::path(seed).stem();
  if (fs::path(seed).extension() != ".raw") {
    return std::nullopt;
  }
  std::string text = name.extension().string().substr(1);
  std::replace(text.begin(), text.end(), '-', ':');
  const auto format = ParseRawFormat(text);
  return format.ok() ? std::optional<RawFormat>(*format) : std::nullopt;
}

void Count(const Status& status, const std::string& path, double seconds, Tally* tally) {
  ++tally->files;
  tally->longest_s = std::max(tally->longest_s, seconds);
  const std::string message(MessageOf(status));
  const bool is_late = seconds > 3 * kSecondsPerFile + kPatienceSeconds;
  // What the plan says of a whole series (no step has a voxel) is about no file.
  const bool is_named = status.ok() ||
                        message.find(fs::path(path).filename().string()) != std::string::npos ||
                        message.find("series") != std::string::npos;
  tally->read += status.ok() ? 1 : 0;
  tally->refused += status.ok() ? 0 : 1;
  tally->died += message.find("of signal") != std::string::npos ? 1 : 0;
  tally->too_long += absl::IsDeadlineExceeded(status) ? 1 : 0;
  if (!is_named || is_late || absl::IsInternal(status)) {
    ++tally->wrong;
    std::printf("wrong: %.1f s, %s: %s\n", seconds, path.c_str(), status.ToString().c_str());
    fs::copy_file(path, fs::temp_directory_path() / ("wrong-" + fs::path(path).filename().string()),
                  fs::copy_options::overwrite_existing);
  }
}

std::string Mutant(const std::string& whole, Random* random) {
  std::string bytes = whole;
  for (size_t times = Below(4, random) + 1; times > 0; --times) {
    MutateOnce(&bytes, random);
  }
  return bytes;
}

/// Takes files that are there, each in so many seconds, and removes them.
void TakeGroup(const IngestOptions& options, const std::vector<std::string>& paths, Tally* tally) {
  const bool is_picture = FormatByName(paths.front()) == FileFormat::kPicture;
  WorkerOptions worker;
  worker.limits = options.worker;
  worker.files = paths;
  worker.pictures = true;
  WorkerClient client(worker);  // starts at the first picture
  for (const std::string& path : paths) {
    const auto begin = std::chrono::steady_clock::now();
    const Status status = is_picture ? TakePicture(options, path, &client) : Take(options, path);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    Count(status, path, seconds, tally);
  }
  for (const std::string& path : paths) {
    fs::remove(path);
  }
}

Tally Mutate(const std::string& seed, int64_t count, uint64_t random_seed,
             const std::string& folder) {
  constexpr int64_t kGroup = 32;
  const std::string whole = ReadWhole(seed);
  IngestOptions options;
  options.worker.seconds_per_file = kSecondsPerFile;
  options.worker.memory_bytes = kWorkerMemoryBytes;
  options.raw = FormatOf(seed);
  Random random(random_seed);
  Tally tally;
  for (int64_t first = 0; first < count; first += kGroup) {
    std::vector<std::string> paths;
    for (int64_t i = first; i < std::min(first + kGroup, count); ++i) {
      paths.push_back(folder + "/m" + std::to_string(i) + fs::path(seed).extension().string());
      std::ofstream(paths.back(), std::ios::binary) << Mutant(whole, &random);
    }
    TakeGroup(options, paths, &tally);
  }
  return tally;
}

int Main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "mutate_files COUNT SEED FILE...\n");
    return 2;
  }
  const int64_t count = std::atoll(argv[1]);
  const uint64_t random_seed = std::strtoull(argv[2], nullptr, 10);
  std::string folder = (fs::temp_directory_path() / "fovea-mutate-XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) {
    return 1;
  }
  int64_t wrong = 0;
  for (int i = 3; i < argc; ++i) {
    const Tally tally = Mutate(argv[i], count, random_seed + static_cast<uint64_t>(i), folder);
    wrong += tally.wrong + (tally.files == count ? 0 : 1);
    std::printf(
        "%s: %ld files: %ld read, %ld refused (the worker died in %ld, was stopped in %ld); "
        "longest "
        "%.2f s; %ld wrong\n",
        fs::path(argv[i]).filename().c_str(), tally.files, tally.read, tally.refused, tally.died,
        tally.too_long, tally.longest_s, tally.wrong);
    std::fflush(stdout);
  }
  fs::remove_all(folder);
  return wrong == 0 ? 0 : 1;
}

}  // namespace
}  // namespace fovea::ingest

int main(int argc, char** argv) {
  return fovea::ingest::Main(argc, argv);
}
