#include "link/slcan_link.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <memory>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include "link/lcm_link.h"

namespace hpmc {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kRepeat{100};
constexpr char kOpenChannel[] = {'S', '8', SLCAN_CR, 'O', SLCAN_CR};
constexpr const char *kScheme = "slcan:";
constexpr const char *kTcp = "tcp:";
constexpr std::pair<const char *, speed_t> kBauds[]{
    {"9600", B9600},     {"57600", B57600},   {"115200", B115200},   {"230400", B230400},
    {"460800", B460800}, {"921600", B921600}, {"1000000", B1000000}, {"2000000", B2000000}};

bool begins_with(const std::string &text, const char *head) {
    return text.rfind(head, 0) == 0;
}

LinkError cannot_open(const std::string &owner, const std::string &address,
                      const std::string &why) {
    return LinkError(owner + ": " + address + ": " + why);
}

/// A connection that was made before the deadline, else -1 with errno.
int connect_to(const addrinfo &peer, int timeout_ms) {
    const int fd = socket(peer.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0) {
        return -1;
    }
    int error = connect(fd, peer.ai_addr, peer.ai_addrlen) == 0 ? 0 : errno;
    if (error == EINPROGRESS) {
        pollfd data{fd, POLLOUT, 0};
        socklen_t size = sizeof error;
        if (poll(&data, 1, timeout_ms) <= 0) {
            error = ETIMEDOUT;
        } else {
            getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
        }
    }
    if (error != 0) {
        close(fd);
        errno = error;
        return -1;
    }
    const int on = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return fd;
}

int open_tcp(const std::string &owner, const std::string &address, int timeout_ms) {
    const std::string peer = address.substr(std::strlen(kScheme) + std::strlen(kTcp));
    const std::size_t colon = peer.rfind(':');
    if (colon == std::string::npos || colon == 0 || colon + 1 == peer.size()) {
        throw cannot_open(owner, address, "must be slcan:tcp:HOST:PORT");
    }
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_NUMERICSERV;
    addrinfo *found = nullptr;
    const int status =
        getaddrinfo(peer.substr(0, colon).c_str(), peer.substr(colon + 1).c_str(), &hints, &found);
    if (status != 0) {
        throw cannot_open(owner, address, gai_strerror(status));
    }
    const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> peers(found, freeaddrinfo);
    int fd = -1;
    for (const addrinfo *one = found; one != nullptr && fd < 0; one = one->ai_next) {
        fd = connect_to(*one, timeout_ms);
    }
    if (fd < 0) {
        throw cannot_open(owner, address, std::strerror(errno));
    }
    return fd;
}

int open_device(const std::string &owner, const std::string &address) {
    std::string device = address.substr(std::strlen(kScheme));
    speed_t speed = B1000000;
    const std::size_t at = device.rfind('@');
    if (at != std::string::npos) {
        const std::string baud = device.substr(at + 1);
        const auto *known = std::find_if(std::begin(kBauds), std::end(kBauds),
                                         [&](const auto &entry) { return baud == entry.first; });
        if (known == std::end(kBauds)) {
            throw cannot_open(owner, address, "the baud rate must be one of 9600 to 2000000");
        }
        speed = known->second;
        device.resize(at);
    }
    const int fd = ::open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    termios settings{};
    if (fd < 0 || tcgetattr(fd, &settings) != 0) {
        const int error = errno;
        if (fd >= 0) {
            close(fd);
        }
        throw cannot_open(owner, address,
                          error == ENOTTY ? "is not a serial device" : std::strerror(error));
    }
    cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    cfsetspeed(&settings, speed);
    tcsetattr(fd, TCSANOW, &settings);
    ioctl(fd, TIOCEXCL);
    return fd;
}

int open_line(const std::string &owner, const std::string &address, int timeout_ms) {
    if (!begins_with(address, kScheme) || address.size() == std::strlen(kScheme)) {
        throw cannot_open(owner, address, "must be slcan:tcp:HOST:PORT or slcan:DEVICE");
    }
    return begins_with(address.substr(std::strlen(kScheme)), kTcp)
               ? open_tcp(owner, address, timeout_ms)
               : open_device(owner, address);
}

} // namespace

SlcanLink::SlcanLink(const std::string &address, const std::string &owner, int timeout_ms)
    : SlcanLink(open_line(owner, address, timeout_ms), owner + " (" + address + ")", timeout_ms) {}

SlcanLink::SlcanLink(int fd, std::string owner, int timeout_ms)
    : owner_(std::move(owner)), timeout_ms_(timeout_ms), fd_(fd) {
    fcntl(fd_, F_SETFL, fcntl(fd_, F_GETFL) | O_NONBLOCK);
    int type = 0;
    socklen_t size = sizeof type;
    socket_ = getsockopt(fd_, SOL_SOCKET, SO_TYPE, &type, &size) == 0;
}

SlcanLink::~SlcanLink() {
    // Nobody waits for the answer, and a peer that is gone already does not matter.
    static const char close_channel[] = {SLCAN_CR, 'C', SLCAN_CR};
    if (socket_) {
        (void)!::send(fd_, close_channel, sizeof close_channel, MSG_NOSIGNAL);
    } else {
        (void)!::write(fd_, close_channel, sizeof close_channel);
    }
    close(fd_);
}

void SlcanLink::fail(const std::string &what) const {
    throw LinkError(owner_ + ": " + what);
}

SlcanLink::Clock::time_point SlcanLink::deadline() const {
    return Clock::now() + milliseconds(timeout_ms_);
}

bool SlcanLink::wait_for(short event, Clock::time_point until) const {
    for (;;) {
        const auto rest = std::chrono::ceil<milliseconds>(until - Clock::now());
        pollfd data{fd_, event, 0};
        const int ready = poll(&data, 1, static_cast<int>(std::max<long>(rest.count(), 0)));
        if (ready > 0) {
            return true; // also for an error, which the following call reports
        }
        if (ready == 0 || errno != EINTR) {
            return false;
        }
    }
}

void SlcanLink::write(const char *text, std::size_t length) {
    const auto until = deadline();
    while (length > 0) {
        const ssize_t written =
            socket_ ? ::send(fd_, text, length, MSG_NOSIGNAL) : ::write(fd_, text, length);
        if (written > 0) {
            text += written;
            length -= static_cast<std::size_t>(written);
        } else if (errno != EAGAIN && errno != EINTR) {
            fail(std::string("cannot send: ") + std::strerror(errno));
        } else if (!wait_for(POLLOUT, until)) {
            fail("took nothing for " + std::to_string(timeout_ms_) + " ms");
        }
    }
}

bool SlcanLink::fill() {
    for (;;) {
        const ssize_t got = ::read(fd_, buffer_.data(), buffer_.size());
        if (got > 0) {
            buffer_first_ = 0;
            buffer_end_ = static_cast<std::size_t>(got);
            return true;
        }
        if (got < 0 && errno == EAGAIN) {
            return false;
        }
        if (got == 0 || errno != EINTR) {
            fail(got == 0 ? std::string("the line was closed")
                          : std::string("cannot receive: ") + std::strerror(errno));
        }
    }
}

void SlcanLink::take_answer() {
    if (!counts_answers_) {
        return;
    }
    if (unanswered_ == 0) {
        ++stats_.garbled;
        fail("answered more lines than it was sent");
    }
    --unanswered_;
}

void SlcanLink::take_line(PeriodFrames &frames) {
    can_frame_t frame;
    const std::string text(line_.text, line_.length);
    switch (text.empty() ? SLCAN_CR : text.front()) {
    case SLCAN_CR:
        take_answer();
        return;
    case 'z':
    case 'Z': // an adapter that took a frame with an 11-bit or a 29-bit identifier
        if (text.size() == 1) {
            take_answer();
            return;
        }
        break;
    case 'T':
    case 'R':
    case 'r':
        ++stats_.ignored;
        return;
    default:
        if (slcan_to_frame(line_.text, line_.length, &frame)) {
            ++stats_.frames_received;
            frames.append(&frame, 1);
            return;
        }
        break;
    }
    ++stats_.garbled;
    fail("sent a line that is none: \"" + text + "\"");
}

void SlcanLink::take(std::uint8_t byte, PeriodFrames &frames) {
    if (byte == static_cast<std::uint8_t>(SLCAN_BEL)) {
        ++stats_.refused;
        fail("refused a line");
    }
    switch (slcan_receive(byte, &line_)) {
    case SLCAN_LINE:
        take_line(frames);
        break;
    case SLCAN_GARBLED:
        ++stats_.garbled;
        fail("sent a garbled line");
    case SLCAN_PENDING:
        break;
    }
}

template <class Done> bool SlcanLink::take_until(Done done, PeriodFrames &frames) {
    const auto until = deadline();
    for (;;) {
        while (buffer_first_ < buffer_end_ && !done()) {
            take(buffer_[buffer_first_++], frames);
        }
        if (done()) {
            return true;
        }
        if (Clock::now() >= until || (!fill() && !wait_for(POLLIN, until))) {
            return false;
        }
    }
}

bool SlcanLink::skip_to(char command, Clock::time_point until) {
    for (;;) {
        while (buffer_first_ < buffer_end_) {
            const std::uint8_t byte = buffer_[buffer_first_++];
            if (byte == static_cast<std::uint8_t>(SLCAN_BEL)) {
                line_ = {}; // ends what came before it, too
            } else if (slcan_receive(byte, &line_) == SLCAN_LINE && line_.length > 1 &&
                       line_.text[0] == command) {
                return true;
            }
        }
        if (Clock::now() >= until || (!fill() && !wait_for(POLLIN, until))) {
            return false;
        }
    }
}

/// A board that is still starting loses what it is sent, so V is asked again; once it answers, N
/// is asked once, and all that came before its answer is of no interest.
void SlcanLink::synchronise() {
    static const char hello[] = {SLCAN_CR, SLCAN_CR, 'C', SLCAN_CR, 'V', SLCAN_CR};
    static const char number[] = {'N', SLCAN_CR};
    const auto until = deadline();
    do {
        write(hello, sizeof hello);
    } while (!skip_to('V', std::min(until, Clock::now() + kRepeat)) && Clock::now() < until);
    if (Clock::now() < until) {
        write(number, sizeof number);
    }
    if (!skip_to('N', until)) {
        fail("did not answer within " + std::to_string(timeout_ms_) +
             " ms; is there a node that speaks SLCAN?");
    }
}

void SlcanLink::open_node() {
    PeriodFrames ignored;
    unanswered_ = 0;
    synchronise();
    write(kOpenChannel, sizeof kOpenChannel);
    unanswered_ = 2;
    await_answers(ignored);
}

/// As the kernel's tool slcand does it: adapters differ in what they answer, some never do.
void SlcanLink::open_adapter() {
    static const char close_channel[] = {SLCAN_CR, SLCAN_CR, 'C', SLCAN_CR};
    for (const auto &[text, length] : {std::pair{close_channel, sizeof close_channel},
                                       std::pair{kOpenChannel, sizeof kOpenChannel}}) {
        write(text, length);
        (void)skip_to('\0', Clock::now() + kRepeat); // no line begins so: all of it
    }
    line_ = {};
    counts_answers_ = false;
}

void SlcanLink::send(const can_frame_t *frames, std::size_t count) {
    std::array<char, PeriodFrames::kMax * SLCAN_TEXT_MAX> text;
    if (count > PeriodFrames::kMax) {
        fail("more frames in a period than a line takes");
    }
    std::size_t length = 0;
    for (std::size_t i = 0; i < count; ++i) {
        length += slcan_from_frame(&frames[i], text.data() + length);
    }
    unanswered_ += count;
    stats_.lines_sent += static_cast<std::int64_t>(count);
    write(text.data(), length);
}

void SlcanLink::await_answers(PeriodFrames &frames) {
    if (!take_until([&] { return unanswered_ == 0; }, frames)) {
        fail("left " + std::to_string(unanswered_) + " lines unanswered for " +
             std::to_string(timeout_ms_) + " ms");
    }
}

void SlcanLink::receive(std::size_t count, PeriodFrames &frames) {
    const std::size_t wanted = frames.count + count;
    if (wanted > PeriodFrames::kMax) {
        fail("more frames in a period than the host takes");
    }
    if (!take_until([&] { return frames.count >= wanted; }, frames)) {
        fail(std::to_string(wanted - frames.count) + " of " + std::to_string(count) +
             " frames were lost");
    }
}

void SlcanLink::receive_available(PeriodFrames &frames) {
    do {
        while (buffer_first_ < buffer_end_) {
            take(buffer_[buffer_first_++], frames);
        }
    } while (frames.count < PeriodFrames::kMax && fill()); // the rest waits for the next call
}

} // namespace hpmc
