// Appends steps to a store until it is killed: store_test_writer PATH
// Makes the store if there is none. Exits with 1 and says why if it cannot.

#include <cstdio>

#include "engine/store/dataset_writer.h"
#include "tests/unit/engine/store/store_test_util.h"

int main(int argc, char** argv) {
  using fovea::store::DatasetWriter;
  namespace testing = fovea::store::testing;
  if (argc != 2) {
    std::fprintf(stderr, "usage: store_test_writer PATH\n");
    return 2;
  }
  auto writer = DatasetWriter::Append(argv[1]);
  if (!writer.ok()) {
    writer = DatasetWriter::Create(argv[1], testing::MakeInfo({40, 33, 50}, 8));
  }
  fovea::Status status = writer.status();
  while (status.ok()) {
    status = testing::WriteSteps(writer->get(), 1);
  }
  std::fprintf(stderr, "%s\n", std::string(fovea::MessageOf(status)).c_str());
  return 1;
}
