#ifndef SERVICE_CLIENT_LOCAL_RENDERER_H_
#define SERVICE_CLIENT_LOCAL_RENDERER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "service/client/client.h"
#include "service/coefficients/held_step.h"
#include "service/frames/spec.h"
#include "service/wire/coefficient_messages.h"

namespace fovea::client {

/// Renders here what a server keeps: fetches coefficients, only those it does not hold, and draws
/// the server's pictures from them, bit for bit ("render local", Yu et al., section 7). Holds the
/// step fetched last and the one before it. Not thread-safe.
class LocalRenderer {
 public:
  struct Progress {
    std::optional<Rate> reached;  // nothing: not even the first rate is whole
    uint64_t blocks = 0;          // received by this Fetch, and their bytes
    uint64_t bytes = 0;
    bool complete = false;
  };
  /// Returns whether to go on; Render may be called meanwhile.
  using OnGrowth = std::function<bool(const Progress&)>;

  /// `client` must outlive it. `threads` that render: 0 for all processors.
  LocalRenderer(CoefficientStreams& client, std::string dataset, int threads)
      : client_(client), dataset_(std::move(dataset)), threads_(threads) {}

  /// Fetches what `spec` needs at `step` and is not here. Calls `on_growth` after each message; if
  /// it returns false, what came so far is kept, and OK is returned. A stream that is cut goes on
  /// where it was. Errors are the server's; INTERNAL for replies that cannot be what it promises.
  [[nodiscard]] Status Fetch(int64_t step, const frames::FrameSpec& spec,
                             const OnGrowth& on_growth = {});

  /// The spec last fetched, nothing left to default, at the rate reached so far.
  /// FAILED_PRECONDITION while there is none.
  [[nodiscard]] StatusOr<frames::FrameSpec> Reached() const;
  /// The step last fetched as `resolved` says, whose view and all else may be another than
  /// Reached's: its fields, and a fovea and rate whose coefficients are here. FAILED_PRECONDITION
  /// otherwise. Its statistics count blocks and bytes of the last Fetch where the server's count
  /// chunks.
  [[nodiscard]] StatusOr<frames::Frame> Render(const frames::FrameSpec& resolved) const;

  /// Of the last Fetch.
  [[nodiscard]] const Progress& progress() const { return progress_; }

 private:
  /// The field and color_field of a spec: what is held is of these.
  using Fields = std::pair<std::optional<std::string>, std::optional<std::string>>;

  /// A step, and the warnings of the fetches before the one under way.
  struct Kept {
    coefficients::HeldStep held;
    std::vector<frames::Warning> warnings;
  };

  void Turn(int64_t step, const Fields& fields);
  void Drop();
  [[nodiscard]] std::vector<wire::HeldCoefficients> Held() const;
  [[nodiscard]] Status FetchOnce(wire::CoefficientsRequest request, const OnGrowth& on_growth);
  [[nodiscard]] Status Take(const wire::CoefficientsMessage& message,
                            const wire::CoefficientsRequest& request);
  [[nodiscard]] Status Begin(const wire::CoefficientsSummary& set, int64_t step);

  CoefficientStreams& client_;
  const std::string dataset_;
  const int threads_;
  Fields fields_;
  std::unique_ptr<Kept> current_;                 // null until the first message
  std::unique_ptr<Kept> previous_;                // what differences are from; may be null
  std::optional<wire::CoefficientsSummary> set_;  // of current_
  std::vector<frames::Warning> warnings_;         // of the last fetch
  Progress progress_;
  // Of the stream under way.
  bool begun_ = false, ended_ = false;
  uint64_t next_index_ = 0;
  int64_t values_left_ = 0;  // that a server may still send
  std::string resume_token_;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_LOCAL_RENDERER_H_
