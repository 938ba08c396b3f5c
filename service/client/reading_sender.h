#ifndef SERVICE_CLIENT_READING_SENDER_H_
#define SERVICE_CLIENT_READING_SENDER_H_

#include <cstdint>
#include <functional>
#include <span>

#include "engine/base/status.h"
#include "engine/sensors/reading_binner.h"
#include "service/wire/readings_spec.h"

namespace fovea::client {

using wire::ReadingsSpec;

/// What has become of the readings so far.
struct SendingReport {
  uint64_t batches = 0;         // sent
  uint64_t acknowledged = 0;    // of these, safe
  int64_t committed_steps = 0;  // of the dataset
  /// Of all calls: what was sent again after a lost connection counts again, as late where its step
  /// was committed.
  sensors::ReadingCounts counts;
  int resumed = 0;  // how often the connection was lost and made again
};

/// A server that reads nothing more for now: the token is above its quota of bytes in.
struct HeldBack {
  double seconds = 0;  // how long still
  uint64_t acknowledged = 0;
  int64_t committed_steps = 0;
};
/// Called about once a second while that lasts, on a thread of the sender's own, while Send or
/// Finish may wait. False gives up: these return CANCELLED then.
using OnHeld = std::function<bool(const HeldBack&)>;

/// Live readings to a server: made by Client::SendReadings, which it must not outlive. Keeps what
/// is not acknowledged; when the connection is lost or the server restarts, it connects again and
/// sends that again, so that nothing is lost and nothing counts twice. Not thread-safe.
class ReadingSender {
 public:
  virtual ~ReadingSender() = default;

  /// Sends readings, in batches that fit; waits while the server holds it back (OnHeld), or is
  /// away. `values` holds one for each field. Errors are the server's; after one nothing more can
  /// be sent. What has room again later is tried again, but not for ever if nothing becomes safe.
  [[nodiscard]] virtual Status Send(std::span<const sensors::Reading> readings,
                                    std::span<const float> values) = 0;
  /// Closes every step and waits until all is acknowledged.
  [[nodiscard]] virtual Status Finish() = 0;
  [[nodiscard]] virtual SendingReport report() const = 0;
};

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_READING_SENDER_H_
