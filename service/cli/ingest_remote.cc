#include "service/cli/ingest_remote.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include <nlohmann/json.hpp>

#include "engine/base/stopwatch.h"
#include "ingest/given.h"
#include "ingest/odd_values.h"
#include "ingest/step_reader.h"
#include "service/cli/console.h"
#include "service/client/client.h"

namespace fovea::cli {
namespace {

/// How long a server may be away, in seconds.
constexpr double kAwaySeconds = 60;
constexpr std::chrono::milliseconds kPause{500};

client::UploadSpec::Type TypeOf(const wavelet::VoxelSpan& values) {
  using Type = client::UploadSpec::Type;
  constexpr Type kTypes[] = {Type::kUint8, Type::kInt8, Type::kUint16, Type::kInt16,
                             Type::kFloat32};
  static_assert(std::variant_size_v<wavelet::VoxelSpan> == std::size(kTypes));
  return kTypes[values.index()];
}

std::span<const std::byte> BytesOf(const wavelet::VoxelSpan& values) {
  return std::visit([](const auto& typed) { return std::as_bytes(typed); }, values);
}

/// How a call ends that can be made again: the server is away, or has not heard yet that the call
/// before is over.
bool MayPass(const Status& status, bool was_cut_off) {
  return absl::IsUnavailable(status) ||
         (was_cut_off && absl::IsFailedPrecondition(status) &&
          MessageOf(status).find("is being written by") != std::string::npos);
}

/// Sends the steps of a series that the server has not.
class Uploader {
 public:
  Uploader(const IngestCommand& command, const ingest::PlannedSeries& planned,
           client::Client& server, Progress* progress)
      : command_(command),
        planned_(planned),
        server_(server),
        progress_(progress),
        odd_(planned.plan.fields) {}

  /// Goes on when the server was away.
  [[nodiscard]] Status Run() {
    std::optional<Stopwatch> away;
    while (next_ < steps()) {
      const int64_t before = bytes_;
      const Status status = SendFrom(next_);
      if (status.ok()) {
        continue;
      }
      if (!MayPass(status, away.has_value())) {
        return status;
      }
      if (!away || bytes_ > before) {
        away.emplace();  // it took some of it: it was not away until now
      }
      if (away->ElapsedMs() > kAwaySeconds * 1000) {
        return status;
      }
      std::this_thread::sleep_for(kPause);
    }
    return absl::OkStatus();
  }

  [[nodiscard]] int64_t steps() const { return std::ssize(planned_.plan.steps); }
  [[nodiscard]] int64_t steps_before() const { return steps_before_; }
  [[nodiscard]] int64_t bytes() const { return bytes_; }
  [[nodiscard]] std::vector<std::string> Warnings() const {
    std::vector<std::string> warnings = planned_.plan.warnings;
    const std::vector<std::string> odd = odd_.Warnings();
    warnings.insert(warnings.end(), odd.begin(), odd.end());
    return warnings;
  }

 private:
  /// Up to the end, or to the first step that the server has already: then it is known where to go
  /// on.
  Status SendFrom(int64_t first) {
    ingest::SeriesPlan rest = planned_.plan;
    rest.steps.erase(rest.steps.begin(), rest.steps.begin() + first);
    ingest::StepReader reader(command_.ingest, rest, {});
    for (next_ = first; next_ < steps();) {
      if (Interrupted()) {
        return Cancelled("stopped as asked, after {} of {} steps", next_, steps());
      }
      progress_->Update(next_, steps(),
                        rest.steps[static_cast<size_t>(next_ - first)].sources[0].path);
      FOVEA_ASSIGN_OR_RETURN(const client::UploadAnswer answer, SendStep(&reader));
      if (answer.already) {
        next_ = std::clamp(answer.committed_steps, next_ + 1, steps());
        steps_before_ += next_ - first;
        return absl::OkStatus();
      }
      ++next_;
    }
    return absl::OkStatus();
  }

  StatusOr<client::UploadAnswer> SendStep(ingest::StepReader* reader) {
    FOVEA_ASSIGN_OR_RETURN(ingest::StepPart part, reader->Next());
    const auto* first = std::get_if<ingest::DensePiece>(&part);
    if (first == nullptr) {
      return Internal("malformed message: a dense file without voxels");
    }
    std::optional<ingest::DenseEnd> end_of_field;
    auto answer = server_.UploadStep(
        SpecOf(TypeOf(first->slices.values)), [&](const client::SendVoxels& send) -> Status {
          while (!std::holds_alternative<ingest::StepEnd>(part)) {
            if (const auto* piece = std::get_if<ingest::DensePiece>(&part)) {
              const auto bytes = BytesOf(piece->slices.values);
              FOVEA_RETURN_IF_ERROR(send(bytes));
              bytes_ += std::ssize(bytes);
            } else if (const auto* end = std::get_if<ingest::DenseEnd>(&part)) {
              end_of_field = *end;
            }
            FOVEA_ASSIGN_OR_RETURN(part, reader->Next());
          }
          return absl::OkStatus();
        });
    if (answer.ok() && !answer->already && end_of_field) {
      odd_.Count(0, Step().sources[0].path, end_of_field->nonfinite, end_of_field->rounded);
    }
    return answer;
  }

  [[nodiscard]] const ingest::PlannedStep& Step() const {
    return planned_.plan.steps[static_cast<size_t>(next_)];
  }

  [[nodiscard]] client::UploadSpec SpecOf(client::UploadSpec::Type type) const {
    const ingest::SeriesPlan& plan = planned_.plan;
    client::UploadSpec spec;
    spec.dataset = command_.ingest.output;
    spec.step = next_;
    spec.time_ns = Step().time_ns;
    spec.frame_number = Step().frame_number;
    spec.dims = plan.extent.Size();
    spec.fields = {{plan.fields.front(), type, plan.value_units.front()}};
    spec.index_to_world = plan.index_to_world;
    spec.world_unit = plan.world_unit;
    spec.wavelet = command_.ingest.wavelet;
    spec.lossless = command_.ingest.lossless;
    spec.chunk_edge = command_.ingest.chunk_edge;
    spec.source = store::SourceInfo{planned_.series, steps(), 0, 1};
    return spec;
  }

  const IngestCommand& command_;
  const ingest::PlannedSeries& planned_;
  client::Client& server_;
  Progress* progress_;
  ingest::OddValues odd_;
  int64_t next_ = 0, steps_before_ = 0, bytes_ = 0;
};

StatusOr<ingest::PlannedSeries> Plan(const IngestCommand& command, Progress* progress) {
  FOVEA_ASSIGN_OR_RETURN(ingest::PlannedSeries planned,
                         ingest::PlanIngest(command.ingest, [&](const ingest::IngestProgress& now) {
                           progress->Update(now.steps_done, now.steps_total, now.now);
                           return !Interrupted();
                         }));
  if (!planned.scanned.front().info.is_dense) {
    return InvalidArgument(
        "--server: {} holds sparse voxels, which are not sent; ingest it here, or where the server "
        "can read it (--ingest-root, `fovea jobs`)",
        planned.scanned.front().file.path);
  }
  return planned;
}

void PrintSent(const IngestCommand& command, const ingest::PlannedSeries& planned,
               const Uploader& uploader, double seconds) {
  const Int3 dims = planned.plan.extent.Size();
  const int64_t sent = uploader.steps() - uploader.steps_before();
  if (command.output.json) {
    PrintJson(nlohmann::json({{"dataset", command.ingest.output},
                              {"steps", sent},
                              {"steps_before", uploader.steps_before()},
                              {"nx", dims.x},
                              {"ny", dims.y},
                              {"nz", dims.z},
                              {"fields", planned.plan.fields},
                              {"warnings", uploader.Warnings()},
                              {"sent_bytes", uploader.bytes()},
                              {"total_ms", seconds * 1000}}));
    return;
  }
  for (const std::string& warning : uploader.Warnings()) {
    Note(command.output, "note: " + warning);
  }
  if (uploader.steps_before() > 0) {
    PrintLine(fmt::format("{}: {} steps were there already", command.ingest.output,
                          uploader.steps_before()));
  }
  const double mib = static_cast<double>(uploader.bytes()) / (1 << 20);
  PrintLine(fmt::format("{}: {} steps of {} x {} x {} voxels to {}; {} sent in {} ({:.1f} MiB/s)",
                        command.ingest.output, sent, dims.x, dims.y, dims.z, *command.server,
                        HumanBytes(static_cast<uint64_t>(uploader.bytes())), HumanSeconds(seconds),
                        mib / std::max(seconds, 1e-9)));
}

}  // namespace

Status CheckUpload(const IngestCommand& command) {
  const std::pair<bool, const char*> others[] = {
      {!command.plan.empty(), "--plan"},
      {!command.from_plan.empty(), "--from-plan"},
      {command.watch, "--watch"},
      {command.ingest.append, "--append"},
      {command.ingest.tolerance.has_value(), "--tolerance"},
      {command.ingest.extent.has_value(), "--extent"},
      {!command.ingest.retain.empty(), "--retain"}};
  for (const auto& [given, flag] : others) {
    if (given) {
      return InvalidArgument("{}: not with --server, which takes whole series of dense voxels",
                             flag);
    }
  }
  return absl::OkStatus();
}

Status UploadFiles(const IngestCommand& command) {
  const Stopwatch watch;
  FOVEA_ASSIGN_OR_RETURN(const auto server,
                         client::Client::Connect(*command.server, command.credentials));
  // One that goes away is waited for; one that was never there is not.
  const auto there = server->GetDataset(command.ingest.output);
  if (absl::IsUnavailable(there.status())) {
    return there.status();
  }
  std::optional<ingest::PlannedSeries> planned;
  std::optional<Uploader> uploader;
  {
    Progress progress(command.output, "ingest", "steps");
    FOVEA_ASSIGN_OR_RETURN(planned, Plan(command, &progress));
    uploader.emplace(command, *planned, *server, &progress);
    FOVEA_RETURN_IF_ERROR(uploader->Run());
  }
  PrintSent(command, *planned, *uploader, watch.ElapsedMs() / 1000);
  return absl::OkStatus();
}

}  // namespace fovea::cli
