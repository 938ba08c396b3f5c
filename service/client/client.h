#ifndef SERVICE_CLIENT_CLIENT_H_
#define SERVICE_CLIENT_CLIENT_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "service/client/dataset_watch.h"
#include "service/client/reading_sender.h"
#include "service/client/upload.h"
#include "service/frames/animation.h"
#include "service/frames/plan.h"
#include "service/frames/spec.h"
#include "service/wire/coefficient_messages.h"
#include "service/wire/dataset_summary.h"

/// The C++ client of the gRPC service, in plain structs: callers need neither gRPC nor Protobuf.
namespace fovea::client {

/// Its default_spec is what a frame with an empty spec uses; ListDatasets leaves it empty.
using DatasetSummary = wire::DatasetSummary;

struct SequenceRequest {
  std::string dataset;
  int64_t first = 0;
  std::optional<int64_t> last;  // included; default: the last committed step
  int64_t stride = 1;
  frames::FrameSpec spec;
  uint64_t start_index = 0;
  uint32_t window = 2;  // frames ahead of the acknowledgements; 0: none needed
  /// After the last committed step it goes on with each new one, or the newest of several, whenever
  /// that comes. With `first` 0 it begins with the last committed step; without `last`.
  bool follow = false;
  /// Its frames over these steps, instead of one a step; at most Animation::kMaxSentKeys keys.
  std::optional<frames::Animation> path{};
};

/// How to be let in. Empty paths stand for nothing.
struct Credentials {
  std::string ca_file{};    // PEM of the authorities that know the server: calls are then encrypted
  std::string cert_file{};  // PEM of the client's own certificate, for servers that ask for one
  std::string key_file{};   // PEM of its key
  std::string token_file{};  // the token, alone on one line
};

/// Where coefficients come from.
class CoefficientStreams {
 public:
  virtual ~CoefficientStreams() = default;
  /// Calls `on_message` for each message in order; an error of it cancels the stream and is
  /// returned. Blocks are not looked at: LocalRenderer does, and goes on after a lost connection.
  [[nodiscard]] virtual Status StreamCoefficients(
      const wire::CoefficientsRequest& request,
      const std::function<Status(const wire::CoefficientsMessage&)>& on_message) = 0;
};

/// One connection, made by the first call. Errors are the server's, with "server HOST:PORT: " in
/// front; UNAVAILABLE says how to start one. What comes back is checked: INTERNAL if it cannot be
/// what the proto promises. A frame of Encoding::kFoveated becomes a picture, the server's byte for
/// byte, by frames::ExpandFrame. Thread-safe.
class Client : public CoefficientStreams {
 public:
  /// `address` is HOST:PORT; INVALID_ARGUMENT for anything else, and for credentials that do not go
  /// together or with it; NOT_FOUND for a file that cannot be read. `deadline_seconds` bounds each
  /// unary call, and each wait for the next frame of a stream.
  [[nodiscard]] static StatusOr<std::unique_ptr<Client>> Connect(
      const std::string& address, const Credentials& credentials = {},
      double deadline_seconds = 60);

  [[nodiscard]] virtual StatusOr<std::vector<DatasetSummary>> ListDatasets() = 0;
  [[nodiscard]] virtual StatusOr<DatasetSummary> GetDataset(const std::string& dataset) = 0;
  /// Removes it from the server's disk, for good.
  [[nodiscard]] virtual Status DeleteDataset(const std::string& dataset) = 0;
  [[nodiscard]] virtual StatusOr<frames::Frame> RenderFrame(const std::string& dataset,
                                                            int64_t step,
                                                            const frames::FrameSpec& spec) = 0;
  /// What a frame will cost there; with a budget, the largest rate within it. RESOURCE_EXHAUSTED if
  /// there is none.
  [[nodiscard]] virtual StatusOr<frames::FramePlan> PlanFrame(
      const std::string& dataset, int64_t step, const frames::FrameSpec& spec,
      const frames::FrameBudget& budget) = 0;
  /// Calls `on_frame` for each frame in order and acknowledges it when it returns true; returning
  /// false cancels the stream, and OK is returned. If the connection is lost after a frame came,
  /// the stream is asked for again from the frame after it; likewise if it was above a quota that
  /// allows it again within ten seconds, once they have passed.
  [[nodiscard]] virtual Status RenderSequence(
      const SequenceRequest& request,
      const std::function<bool(const frames::Frame&)>& on_frame) = 0;
  /// Tells of each step of a dataset as it is committed, until it is told to stop (then OK) or the
  /// server refuses. If the connection is lost after an event came, it goes on where it was.
  [[nodiscard]] virtual Status WatchDataset(const WatchRequest& request, const OnEvent& on_event,
                                            const GoOn& go_on) = 0;
  /// Sends one step of dense voxels; what `give` returns, unless the server says better why. It is
  /// committed when this returns OK. After UNAVAILABLE (or a limit for now) call again.
  [[nodiscard]] virtual StatusOr<UploadAnswer> UploadStep(const UploadSpec& spec,
                                                          const GiveVoxels& give) = 0;
  /// Opens a dataset of this server for readings. It must outlive what is returned.
  [[nodiscard]] virtual StatusOr<std::unique_ptr<ReadingSender>> SendReadings(
      const ReadingsSpec& spec, OnHeld on_held) = 0;
  [[nodiscard]] StatusOr<std::unique_ptr<ReadingSender>> SendReadings(const ReadingsSpec& spec) {
    return SendReadings(spec, nullptr);
  }
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_CLIENT_H_
