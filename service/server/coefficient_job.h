#ifndef SERVICE_SERVER_COEFFICIENT_JOB_H_
#define SERVICE_SERVER_COEFFICIENT_JOB_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "service/coefficients/block.h"
#include "service/coefficients/plan.h"
#include "service/server/catalogue.h"
#include "service/wire/coefficients.h"

namespace fovea::server {

/// What a stream of coefficients sends, known and checked, and the making of its messages. Not
/// thread-safe.
class CoefficientJob {
 public:
  /// Looks the dataset up, fills in its defaults, and plans. Reads the disk, no coefficient.
  /// RESOURCE_EXHAUSTED above the limit of a frame's super-voxels; INVALID_ARGUMENT pointing at
  /// the field; OUT_OF_RANGE for a step that is not there; FAILED_PRECONDITION for what is held of
  /// a step that is not what it was.
  [[nodiscard]] static StatusOr<std::unique_ptr<CoefficientJob>> Prepare(
      Catalogue& catalogue, const wire::CoefficientsRequest& request);

  /// Messages from `first` to before `end`; at least one.
  [[nodiscard]] int64_t first() const { return first_; }
  [[nodiscard]] int64_t end() const { return end_; }
  /// Of the message `index`.
  [[nodiscard]] int64_t CoefficientsIn(int64_t index) const;
  /// The memory that one message takes while it is made; and what is planned, until the end.
  [[nodiscard]] static int64_t WorkingBytes();
  [[nodiscard]] int64_t PlanBytes() const;

  /// Reads and encodes one block. DATA_LOSS for damaged chunks if the spec is strict.
  [[nodiscard]] StatusOr<wire::CoefficientsMessage> Make(int64_t index);

 private:
  CoefficientJob() = default;
  [[nodiscard]] Status Open(const wire::CoefficientsRequest& request);
  [[nodiscard]] Status TakeHeld(const wire::CoefficientsRequest& request);
  [[nodiscard]] Status Resume(const std::string& token);
  [[nodiscard]] StatusOr<uint64_t> ContentOf(int64_t step, const std::string& field);
  [[nodiscard]] std::string TokenFor(int64_t next) const;
  /// The numbers of the boxes of `header`; with `differences`, only of those that have one.
  [[nodiscard]] StatusOr<std::vector<std::byte>> Read(store::StepSource& source,
                                                      const coefficients::BlockHeader& header,
                                                      bool differences) const;
  [[nodiscard]] StatusOr<std::string> Encode(const coefficients::PlannedBlock& planned);
  [[nodiscard]] std::vector<frames::Warning> Warnings() const;

  std::shared_ptr<ServedDataset> dataset_;
  store::DatasetInfo info_;
  wire::CoefficientsSummary set_;
  coefficients::PlanRequest request_;
  int64_t base_step_ = 0;  // the step itself without a base
  coefficients::Plan plan_;
  uint64_t fingerprint_ = 0;
  int64_t first_ = 0, end_ = 0;
  std::optional<frames::Warning> retention_;
  std::vector<std::unique_ptr<store::StepSource>> sources_;  // of each field
  std::vector<std::unique_ptr<store::StepSource>> bases_;    // likewise; empty without a base
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_COEFFICIENT_JOB_H_
