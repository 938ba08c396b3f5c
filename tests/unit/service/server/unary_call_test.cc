#include "service/server/unary_call.h"

#include <filesystem>
#include <future>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "fovea/v1/render.pb.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::server {
namespace {

TEST(UnaryCallTest, AJobMayOutlastItsCall) {
  const store::testing::TemporaryFolder folder;
  std::filesystem::create_directories(folder.Path("root"));
  auto catalogue = Catalogue::Open(folder.Path("root"), std::chrono::milliseconds(0));
  ASSERT_OK(catalogue.status());
  Services services(*std::move(catalogue), *access::Gate::Open(""), int64_t{1} << 30,
                    {.name = "lookup queue", .flag = "", .threads = 1, .max_waiting = 9},
                    {.name = "render queue", .flag = "", .threads = 1, .max_waiting = 9});
  const grpc::CallbackServerContext context;
  v1::Frame response;
  auto call = UnaryCall<v1::Frame>::Start(services, context, {}, &response);
  std::promise<void> runs, over;
  std::promise<Status> outcome;
  call->Enqueue(services.lookups, 0, [&, call](int) {
    runs.set_value();
    over.get_future().wait();
    outcome.set_value(call->caller().TakePixels(1));
    call->Complete(v1::Frame());
  });
  runs.get_future().wait();
  // As gRPC tells of a client that went away.
  call->OnCancel();
  call->OnDone();
  call.reset();
  over.set_value();
  EXPECT_OK(outcome.get_future().get());
}

}  // namespace
}  // namespace fovea::server
