#ifndef SERVICE_CLI_COMMANDS_H_
#define SERVICE_CLI_COMMANDS_H_

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/merge.h"
#include "engine/store/retention.h"
#include "engine/volume/geometry.h"
#include "ingest/ingest.h"
#include "ingest/sensors/sensor_ingest.h"
#include "ingest/watch.h"
#include "service/access/token.h"
#include "service/cli/values.h"
#include "service/client/client.h"
#include "service/client/jobs_client.h"
#include "service/frames/plan.h"
#include "service/frames/spec.h"

/// What each verb was asked to do, as plain values. parse.cc fills these from the command line.
namespace fovea::cli {

/// How a verb talks.
struct OutputOptions {
  bool json = false;   // one JSON value on stdout
  bool quiet = false;  // no progress, no notes
};

/// What pictures are made of: a dataset, a dataset of a server, or foreign files, which are
/// ingested into the cache first.
struct PictureInput {
  std::vector<std::string> inputs;
  std::optional<std::string> server;  // HOST:PORT; inputs[0] is then a dataset's name there
  client::Credentials credentials;    // for the server
  bool foveated = false;              // the server sends FOVEATED frames, which are expanded here
  bool local = false;                 // the server sends coefficients, which are rendered here
  ingest::IngestOptions ingest;       // for foreign files; inputs and output not filled in
  std::string cache;                  // empty: the usual place
  int threads = 0;
};

struct IngestCommand {
  OutputOptions output;
  ingest::IngestOptions ingest;
  std::string plan;       // only write this plan
  std::string from_plan;  // the series and all flags are of this plan
  std::optional<Shard> shard;
  bool watch = false;
  ingest::WatchOptions watching;
  std::vector<std::string> arguments;  // the whole command line
  std::optional<std::string> server;   // then ingest.output is a name there
  client::Credentials credentials;     // for the server
};

struct SensorsCommand {
  OutputOptions output;
  ingest::SensorOptions ingest;
  std::optional<std::string> server;  // then ingest.output is a name there
  client::Credentials credentials;    // for the server
};

struct InfoCommand {
  OutputOptions output;
  std::string dataset;  // may be empty with a server: all of its datasets
  bool watch = false;   // of a server: go on with each step that is committed
  std::optional<std::string> server;
  client::Credentials credentials;  // for the server
};

struct StatsCommand {
  OutputOptions output;
  std::string dataset;
  std::optional<std::string> field;
  StepRange steps;
};

struct VerifyCommand {
  OutputOptions output;
  std::string dataset;
  int threads = 0;
};

struct RepairCommand {
  OutputOptions output;
  std::string dataset;
  std::string file;  // the new dataset; empty: in place
  bool in_place = false;
  int threads = 0;
};

struct MergeCommand {
  OutputOptions output;
  store::MergeOptions merge;
};

struct RetainCommand {
  OutputOptions output;
  std::string dataset;
  std::vector<store::AskedWindow> windows;
  std::string copy;  // the new dataset; empty with in_place
  bool in_place = false;
};

struct ExtractCommand {
  OutputOptions output;
  std::string dataset;
  int64_t step = 0;
  std::optional<std::string> field;
  std::optional<Box3> box;
  std::optional<frames::Position> fovea;  // any of these three: the foveated volume
  std::optional<Rate> rate;
  std::optional<WindowShape> window;
  bool strict = false;  // a damaged chunk is an error
  std::string file;
};

struct PlanCommand {
  OutputOptions output;
  std::string dataset;
  int64_t step = 0;
  frames::FrameSpec spec;
  frames::FrameBudget budget;  // anything in it: the largest rate within it
  int threads = 0;             // none with a server, which counts its own
  std::optional<std::string> server;
  client::Credentials credentials;  // for the server
};

struct RenderCommand {
  OutputOptions output;
  PictureInput input;
  int64_t step = 0;
  frames::FrameSpec spec;
  std::string file;
  bool refine = false;  // of a server: the file is written coarse first, and again as it sharpens
};

struct ExpandCommand {
  OutputOptions output;
  std::string frame;
  std::string file;
  int threads = 0;
};

struct ExportCommand {
  OutputOptions output;
  PictureInput input;
  StepRange steps;
  frames::FrameSpec spec;
  std::string file;
  std::optional<std::string> animation_file;
  std::optional<double> orbit_deg;
  std::optional<int64_t> orbit_frames;
  std::optional<double> frames_per_second;
  Shard shard;
  bool overwrite = false;
};

struct BenchCommand {
  OutputOptions output;
  std::string dataset;
  int64_t step = 0;
  frames::FrameSpec spec;
  int threads = 0;  // measured beside 1; 0: all processors
  int rounds = 5;   // 1 to 1000
};

/// Everything after `serve` goes to fovead as it is.
struct ServeCommand {
  std::vector<std::string> arguments;
};

/// Long work of a server: what there is of it, and making some.
struct JobsCommand {
  enum class What { kShow, kIngest, kExport };
  OutputOptions output;
  std::optional<std::string> server;
  client::Credentials credentials;
  What what = What::kShow;
  std::string id;                             // kShow: empty: all of them
  int64_t newest = client::JobsClient::kAll;  // of all of them: how many
  bool watch = false;
  bool cancel = false;
  client::IngestRequest ingest;
  client::ExportRequest shot;  // steps and animation not filled in
  StepRange steps;
  std::optional<std::string> animation_file;
  std::optional<double> orbit_deg;
  std::optional<int64_t> orbit_frames;
};

struct TokenCommand {
  OutputOptions output;
  std::string file;
  access::Token token;  // its digest not filled in
  std::string rights = "read";
};

struct DeleteCommand {
  OutputOptions output;
  std::string dataset;  // its name on the server
  std::optional<std::string> server;
  client::Credentials credentials;
  bool yes = false;
};

struct DoctorCommand {
  OutputOptions output;
  std::optional<std::string> folder;
};

struct DemoCommand {
  OutputOptions output;
  std::string folder;
  int64_t edge_voxels = 96;
  int64_t steps = 24;
  int threads = 0;
};

using Command =
    std::variant<IngestCommand, SensorsCommand, InfoCommand, StatsCommand, VerifyCommand,
                 RepairCommand, MergeCommand, RetainCommand, ExtractCommand, PlanCommand,
                 RenderCommand, ExpandCommand, ExportCommand, BenchCommand, ServeCommand,
                 JobsCommand, TokenCommand, DeleteCommand, DoctorCommand, DemoCommand>;

/// A command to run, or a text to print (help, version, what was wrong) and the status to end with.
struct ParseResult {
  std::optional<Command> command;
  std::string text;
  int exit_status = 0;  // of the text: 0 for help and version, else 2 (1: a file is not there)
};

/// `arguments` without the program's name. Never throws, never prints.
[[nodiscard]] ParseResult ParseCommandLine(const std::vector<std::string>& arguments);

[[nodiscard]] Status Run(const IngestCommand& command);
[[nodiscard]] Status Run(const SensorsCommand& command);
[[nodiscard]] Status Run(const InfoCommand& command);
[[nodiscard]] Status Run(const StatsCommand& command);
[[nodiscard]] Status Run(const VerifyCommand& command);
[[nodiscard]] Status Run(const RepairCommand& command);
[[nodiscard]] Status Run(const MergeCommand& command);
[[nodiscard]] Status Run(const RetainCommand& command);
[[nodiscard]] Status Run(const ExtractCommand& command);
[[nodiscard]] Status Run(const PlanCommand& command);
[[nodiscard]] Status Run(const RenderCommand& command);
[[nodiscard]] Status Run(const ExpandCommand& command);
[[nodiscard]] Status Run(const ExportCommand& command);
[[nodiscard]] Status Run(const BenchCommand& command);
[[nodiscard]] Status Run(const ServeCommand& command);
[[nodiscard]] Status Run(const JobsCommand& command);
[[nodiscard]] Status Run(const TokenCommand& command);
[[nodiscard]] Status Run(const DeleteCommand& command);
[[nodiscard]] Status Run(const DoctorCommand& command);
[[nodiscard]] Status Run(const DemoCommand& command);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_COMMANDS_H_
