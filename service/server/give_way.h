#ifndef SERVICE_SERVER_GIVE_WAY_H_
#define SERVICE_SERVER_GIVE_WAY_H_

namespace fovea::server {

/// For threads that the network wakes: while `crowded`, the calling thread lets those that render
/// end their slice instead of taking the processor from them (SCHED_BATCH), which saves two
/// switches a call where thousands are refused a second; else it is scheduled as ever. Cheap when
/// nothing changes. Thread-safe.
void GiveWay(bool crowded);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_GIVE_WAY_H_
