#ifndef SERVICE_CLI_FLAGS_H_
#define SERVICE_CLI_FLAGS_H_

#include <optional>
#include <string>
#include <vector>

#include "service/cli/commands.h"

namespace CLI {
class App;
}

/// Flags that several verbs share. Each writes to what it is given, which must outlive parsing.
namespace fovea::cli {

void AddOutputFlags(CLI::App* app, OutputOptions* output);
void AddThreadsFlag(CLI::App* app, int* threads);
/// --server, and how to be let in there.
void AddServerFlags(CLI::App* app, std::optional<std::string>* server,
                    client::Credentials* credentials);
void AddFieldFlag(CLI::App* app, std::optional<std::string>* field);
void AddFoveaFlags(CLI::App* app, std::optional<frames::Position>* fovea, std::optional<Rate>* rate,
                   std::optional<WindowShape>* window);
void AddStepsFlag(CLI::App* app, StepRange* steps);
/// --orbit, --orbit-frames: instead of --animation, which must be there already.
void AddOrbitFlags(CLI::App* app, std::optional<double>* degrees, std::optional<int64_t>* frames);
/// --view, --span, --center, --size, --transfer and everything else a picture is made of.
void AddPictureFlags(CLI::App* app, frames::FrameSpec* spec);
/// How foreign files are to be read: --raw and its like.
void AddForeignFlags(CLI::App* app, ingest::IngestOptions* ingest);
/// When the steps are: --times, --fps.
void AddTimeFlags(CLI::App* app, ingest::IngestOptions* ingest);
/// What coefficients are made: --wavelet, --lossless.
void AddBasisFlags(CLI::App* app, ingest::IngestOptions* ingest);
/// --plan, --from-plan, --shard: a series in parts.
void AddPartFlags(CLI::App* app, IngestCommand* command);
/// --watch and what goes with it.
void AddWatchFlags(CLI::App* app, IngestCommand* command);
void AddExtentFlag(CLI::App* app, std::optional<Box3>* extent);
/// --retain, which may be given several times.
void AddRetainFlag(CLI::App* app, std::vector<store::AskedWindow>* windows);
/// Positional inputs, --server, --cache, --threads and the foreign flags.
void AddPictureInput(CLI::App* app, PictureInput* input);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_FLAGS_H_
