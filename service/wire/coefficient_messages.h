#ifndef SERVICE_WIRE_COEFFICIENT_MESSAGES_H_
#define SERVICE_WIRE_COEFFICIENT_MESSAGES_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/fovea/retained_set.h"
#include "service/frames/spec.h"
#include "service/wire/dataset_summary.h"

/// The messages of fovea.v1.Coefficients as plain structs.
namespace fovea::wire {

/// Every coefficient of C(fovea, rate) of a step, in the client's hands.
struct HeldCoefficients {
  uint64_t step = 0;
  Fovea fovea;                    // of cubes
  std::vector<uint64_t> content;  // of each field
  friend bool operator==(const HeldCoefficients&, const HeldCoefficients&) = default;
};

struct CoefficientsRequest {
  std::string dataset;
  uint64_t step = 0;
  std::optional<int64_t> time_ns;  // instead of the step
  frames::FrameSpec spec;
  std::vector<HeldCoefficients> held;
  std::string resume_token;
};

/// What the coefficients of a call are of.
struct CoefficientsSummary {
  struct Field {
    std::string name;
    bool reversible = false;
    uint64_t content = 0;
  };
  DatasetSummary dataset;
  int64_t step = 0;
  int64_t time_ns = 0;
  std::optional<int64_t> frame_number;
  frames::FrameSpec used;  // nothing left to default
  std::vector<Field> fields;
  uint64_t blocks = 0, coefficients = 0;
};

struct CoefficientsMessage {
  std::optional<CoefficientsSummary> set;  // in the first message only
  std::string data;                        // one block, or nothing
  std::optional<Rate> reached;
  std::string resume_token;
  uint64_t index = 0;
  std::vector<frames::Warning> warnings;
};

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_COEFFICIENT_MESSAGES_H_
