#define _GNU_SOURCE
#include "port/posix/slcan_server.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "port/posix/stop_signal.h"
#include "port/slcan/slcan_node.h"

enum { EXIT_RUN_ENDED = 3, STEP_us = 1000, LOOK_us = 250000, AMBIENT_dC = 250, CLOSED = -1 };

typedef struct {
    motor_node_config_t *config;
    motor_node_t node;
    slcan_node_t slcan;
    int listener;
    int client; /* CLOSED: none */
    int64_t next_step_us;
} server_t;

static int64_t now_us(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

static void hang_up(server_t *server) {
    (void)close(server->client);
    server->client = CLOSED;
    server->slcan.line = (slcan_line_t){0};
}

/* A client that is gone or does not read is hung up on. */
static void send_text(const slcan_node_text_t *text, server_t *server) {
    if (server->client != CLOSED && text->length > 0U &&
        send(server->client, text->text, text->length, MSG_NOSIGNAL | MSG_DONTWAIT) !=
            (ssize_t)text->length) {
        hang_up(server);
    }
}

static void step(uint32_t elapsed_us, server_t *server) {
    motor_node_input_t input = {.elapsed_us = elapsed_us, .temperature_dC = AMBIENT_dC};
    motor_node_output_t output;
    slcan_node_text_t text;
    slcan_node_input(&server->slcan, &input);
    motor_node_step(server->config, &server->node, &input, &output);
    if (output.reset_requested) {
        motor_node_restart(server->config, &server->node);
    }
    slcan_node_output(&output, &server->slcan, &text);
    send_text(&text, server);
}

static void receive(server_t *server) {
    uint8_t bytes[4096];
    const ssize_t count = recv(server->client, bytes, sizeof bytes, 0);
    if (count <= 0) {
        hang_up(server);
        return;
    }
    for (ssize_t i = 0; i < count && server->client != CLOSED; i++) {
        slcan_node_text_t text;
        const bool due = slcan_node_receive(&server->node, bytes[i], &server->slcan, &text);
        send_text(&text, server);
        if (due) {
            step(0, server);
        }
    }
}

static void answer_call(server_t *server) {
    const int client = accept(server->listener, NULL, NULL);
    if (client >= 0 && server->client == CLOSED) {
        const int on = 1;
        (void)setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        server->client = client;
    } else if (client >= 0) {
        (void)close(client); /* a line has one other end */
    } else {
        /* it has hung up already */
    }
}

static void serve(server_t *server) {
    server->next_step_us = now_us();
    while (!stop_signal_raised()) {
        struct pollfd data[2] = {{.fd = server->listener, .events = POLLIN},
                                 {.fd = server->client, .events = POLLIN}};
        /* Bounded also without a timer: a signal may come just before the wait. */
        const bool stepped = server->node.od.time_base != 0U;
        const int64_t rest_us = stepped ? LOOK_us : server->next_step_us - now_us();
        const struct timespec wait = {.tv_sec = 0, .tv_nsec = rest_us > 0 ? rest_us * 1000 : 0};
        const int ready = ppoll(data, 2, &wait, NULL);
        if (ready > 0 && data[0].revents != 0) {
            answer_call(server);
        } else if (ready > 0 && data[1].revents != 0) {
            receive(server);
        } else {
            /* time, or a signal */
        }
        if (server->node.od.time_base == 0U && now_us() >= server->next_step_us) {
            step(STEP_us, server);
            server->next_step_us += STEP_us;
            if (server->next_step_us < now_us()) { /* held up: no burst of steps */
                server->next_step_us = now_us() + STEP_us;
            }
        }
    }
}

int slcan_server(motor_node_config_t *config, uint16_t port) {
    static server_t server;
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    const int on = 1;
    server = (server_t){.config = config, .client = CLOSED};
    server.listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    (void)setsockopt(server.listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (server.listener < 0 || bind(server.listener, (struct sockaddr *)&address, size) != 0 ||
        listen(server.listener, 1) != 0 ||
        getsockname(server.listener, (struct sockaddr *)&address, &size) != 0) {
        (void)fprintf(stderr, "motor_node %u: port %u: %s\n", (unsigned)config->node_id,
                      (unsigned)port, strerror(errno));
        return EXIT_RUN_ENDED;
    }
    motor_node_init(config, &server.node);
    (void)printf("READY %u\n", (unsigned)ntohs(address.sin_port));
    (void)fflush(stdout);
    serve(&server);
    return 0;
}
