// Kills a writer at random moments, while a reader reads:
//   store_kill_trial FOLDER KILLS [SEED]
// The writer appends steps to FOLDER/trial.zarr and is killed (SIGKILL) and started again; the
// reader reads every committed step again and again and compares every value; after each kill the
// parent looks whether a committed step is gone. Every 50 steps a new store is begun, so that its
// creation is cut off too. Exits with 1 and says why if anything was lost; prints what happened.
// (`--write STORE` and `--read STORE REPORT` are the two children.)

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <spawn.h>

#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/verify.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;

constexpr Int3 kDims{24, 20, 17};
constexpr int64_t kEdge = 8;
constexpr int64_t kStepsOfAStore = 50;

int Write(const std::string& path) {
  auto writer = DatasetWriter::Append(path);
  if (absl::IsNotFound(writer.status()) || absl::IsFailedPrecondition(writer.status())) {
    writer = DatasetWriter::Create(path, testing::MakeInfo(kDims, kEdge));
  }
  Status status = writer.status();
  while (status.ok()) {
    status = testing::WriteSteps(writer->get(), 1);
  }
  std::fprintf(stderr, "the writer: %s\n", std::string(MessageOf(status)).c_str());
  return 1;
}

/// Coarse level and details one after another.
StatusOr<std::vector<float>> AllValues(CoefficientSource* source) {
  std::vector<float> all(static_cast<size_t>(source->hierarchy().DimsAt(0).Product()));
  FOVEA_RETURN_IF_ERROR(source->ReadCoarse(all));
  for (int level = 0; level < source->hierarchy().finest(); ++level) {
    FOVEA_ASSIGN_OR_RETURN(const std::vector<float> detail, testing::ReadLevel(source, level));
    all.insert(all.end(), detail.begin(), detail.end());
  }
  return all;
}

volatile std::sig_atomic_t stop = 0;

class Reader {
 public:
  explicit Reader(std::string path) : path_(std::move(path)) {}

  /// Every committed step once.
  [[nodiscard]] Status Pass() {
    const auto dataset = Dataset::Open(path_);
    if (!dataset.ok() && steps_ < 0 && !absl::IsDataLoss(dataset.status())) {
      return absl::OkStatus();  // not yet created
    }
    FOVEA_RETURN_IF_ERROR(dataset.status());
    const int64_t steps = (*dataset)->info().committed_steps;
    if (steps < steps_) {
      return DataLoss("{} had {} steps, and now {}", path_, steps_, steps);
    }
    steps_ = steps;
    for (int64_t step = 0; step < steps && stop == 0; ++step) {
      FOVEA_RETURN_IF_ERROR(Annotate(Check(**dataset, step), fmt::format("step {}", step)));
      ++checked_;
    }
    return absl::OkStatus();
  }
  [[nodiscard]] uint64_t checked() const { return checked_; }

 private:
  [[nodiscard]] Status Check(Dataset& dataset, int64_t step) {
    std::vector<float>& expected = expected_[step];
    if (expected.empty()) {
      const testing::StepData data = testing::MakeStep(kDims, kEdge, static_cast<int>(step));
      MemorySource memory(data.coefficients);
      FOVEA_ASSIGN_OR_RETURN(expected, AllValues(&memory));
    }
    FOVEA_ASSIGN_OR_RETURN(const auto source, dataset.OpenStep(step, "density", OnDamage::kFail));
    FOVEA_ASSIGN_OR_RETURN(const std::vector<float> values, AllValues(source.get()));
    FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset.TimeNs(step));
    FOVEA_RETURN_IF_ERROR(dataset.Stats(step, "density").status());
    FOVEA_RETURN_IF_ERROR(dataset.FrameNumber(step).status());
    return values == expected && time_ns == step * 1'000'000'000
               ? absl::OkStatus()
               : DataLoss("its values or its time are not those that were written");
  }

  const std::string path_;
  std::map<int64_t, std::vector<float>> expected_;
  int64_t steps_ = -1;  // seen so far; -1: no store yet
  uint64_t checked_ = 0;
};

int Read(const std::string& path, const std::string& report) {
  std::signal(SIGTERM, [](int) { stop = 1; });
  Reader reader(path);
  while (stop == 0) {
    if (const Status status = reader.Pass(); !status.ok()) {
      std::fprintf(stderr, "the reader: %s\n", std::string(MessageOf(status)).c_str());
      return 1;
    }
  }
  std::ofstream(report) << reader.checked();
  return 0;
}

pid_t Start(std::vector<std::string> arguments) {
  std::string self = fs::read_symlink("/proc/self/exe").string();
  arguments.insert(arguments.begin(), self);
  std::vector<char*> pointers;
  for (std::string& argument : arguments) {
    pointers.push_back(argument.data());
  }
  pointers.push_back(nullptr);
  pid_t child = -1;
  return posix_spawn(&child, self.c_str(), nullptr, nullptr, pointers.data(), environ) == 0 ? child
                                                                                            : -1;
}

struct Tally {
  int64_t kills = 0, stores = 0, steps = 0;
  int64_t in_creation = 0;  // kills before there was a store
  int64_t unfinished = 0;   // kills that left files of a commit, or of a creation
  uint64_t read = 0;        // steps that the reader compared
};

/// Whether a killed writer left anything for the next one to sweep up.
bool LeftSomething(const std::string& path, int64_t steps) {
  const std::string next = fmt::format("c.{}.", steps);
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    const std::string name = entry.path().filename().string();
    if (IsTemporaryName(name) || (entry.is_regular_file() && name.starts_with(next))) {
      return true;
    }
  }
  return false;
}

/// Waits until there are more than `before` steps, 10 seconds at most.
void WaitForStep(const std::string& path, int64_t before) {
  for (int i = 0; i < 10'000; ++i) {
    const auto dataset = Dataset::Open(path);
    if (dataset.ok() && (*dataset)->info().committed_steps > std::max<int64_t>(before, 0)) {
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

/// Kills one writer at a random moment. The committed steps then, -1 if there is no store.
StatusOr<int64_t> KillOnce(const std::string& path, int64_t before, std::mt19937_64* random,
                           Tally* tally) {
  const pid_t writer = Start({"--write", path});
  if ((*random)() % 2 == 0) {  // once it has committed something, however slow the machine is
    WaitForStep(path, before);
  }
  std::this_thread::sleep_for(std::chrono::microseconds((*random)() % 60'000));
  ::kill(writer, SIGKILL);
  int status = 0;
  ::waitpid(writer, &status, 0);
  if (!WIFSIGNALED(status)) {
    return Internal("the writer ended by itself");
  }
  ++tally->kills;
  const auto dataset = Dataset::Open(path);
  if (!dataset.ok() && before < 0 && !absl::IsDataLoss(dataset.status())) {
    ++tally->in_creation;
    tally->unfinished += fs::exists(path) ? 1 : 0;
    return -1;
  }
  FOVEA_RETURN_IF_ERROR(dataset.status());
  const int64_t steps = (*dataset)->info().committed_steps;
  tally->unfinished += LeftSomething(path, steps) ? 1 : 0;
  return steps;
}

/// One store from its creation to its last step.
Status OneStore(const std::string& folder, int64_t kills, std::mt19937_64* random, Tally* tally) {
  const std::string path = folder + "/trial.zarr";
  const std::string report = folder + "/reader.txt";
  fs::remove_all(path);
  const pid_t reader = Start({"--read", path, report});
  Status status;
  int64_t steps = -1;
  while (status.ok() && tally->kills < kills && steps < kStepsOfAStore) {
    const StatusOr<int64_t> now = KillOnce(path, steps, random, tally);
    status = now.status();
    if (now.ok() && *now < steps) {
      status = DataLoss("{} had {} steps before the kill, and now {}", path, steps, *now);
    }
    steps = now.value_or(steps);
  }
  ::kill(reader, SIGTERM);
  int ended = 0;
  ::waitpid(reader, &ended, 0);
  FOVEA_RETURN_IF_ERROR(status);
  if (!WIFEXITED(ended) || WEXITSTATUS(ended) != 0) {
    return DataLoss("the reader saw damage");
  }
  uint64_t read = 0;
  std::ifstream(report) >> read;
  tally->read += read;
  ++tally->stores;
  if (steps >= 0) {
    tally->steps += steps;
    FOVEA_ASSIGN_OR_RETURN(const VerifyReport found, Verify(path, 0));
    if (!found.problems.empty()) {
      return DataLoss("{}", found.problems.front());
    }
  }
  return absl::OkStatus();
}

int Trial(const std::string& folder, int64_t kills, uint64_t seed) {
  fs::create_directories(folder);
  std::mt19937_64 random(seed);
  Tally tally;
  Status status;
  while (status.ok() && tally.kills < kills) {
    status = OneStore(folder, kills, &random, &tally);
  }
  std::printf(
      "%ld kills: %ld left something unfinished, %ld came before the store was made; %ld steps "
      "committed in %ld stores; the reader compared %lu steps\n",
      tally.kills, tally.unfinished, tally.in_creation, tally.steps, tally.stores, tally.read);
  if (!status.ok()) {
    std::printf("FAILED: %s\n", std::string(MessageOf(status)).c_str());
    return 1;
  }
  if (tally.steps == 0 || tally.read == 0 || tally.unfinished == 0) {
    std::printf("FAILED: nothing was tried\n");
    return 1;
  }
  fs::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace fovea::store

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (arguments.size() == 2 && arguments[0] == "--write") {
    return fovea::store::Write(arguments[1]);
  }
  if (arguments.size() == 3 && arguments[0] == "--read") {
    return fovea::store::Read(arguments[1], arguments[2]);
  }
  int64_t kills = 0;
  uint64_t seed = 1;
  const auto number = [](const std::string& text, auto* value) {
    return std::from_chars(text.data(), text.data() + text.size(), *value).ec == std::errc();
  };
  if (arguments.size() < 2 || arguments.size() > 3 || !number(arguments[1], &kills) ||
      (arguments.size() == 3 && !number(arguments[2], &seed))) {
    std::fprintf(stderr, "usage: store_kill_trial FOLDER KILLS [SEED]\n");
    return 2;
  }
  return fovea::store::Trial(arguments[0], kills, seed);
}
