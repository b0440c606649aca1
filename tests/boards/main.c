/* Runs an exported model on a board: the bits of 1000 outputs, and the cycles of a step. */
#include <stdint.h>
#include <stdio.h>

#include "model.h"

#ifdef __AVR__
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#define PER_TICK 8
#define BATCH 10 /* more would pass the end of the counter */

static int send(char letter, FILE *stream)
{
    (void)stream;
    while (!(UCSR0A & (1 << UDRE0))) {
    }
    UDR0 = (uint8_t)letter;
    return 0;
}

static FILE port = FDEV_SETUP_STREAM(send, 0, _FDEV_SETUP_WRITE);

static void begin(void)
{
    UCSR0A = 1 << U2X0;
    UBRR0 = 0;
    UCSR0B = 1 << TXEN0;
    stdout = &port;
    TCCR1A = 0;
    TCCR1B = 1 << CS11;
}

static uint32_t ticks(void)
{
    return TCNT1;
}

static uint32_t between(uint32_t first, uint32_t last)
{
    return (uint16_t)(last - first);
}

static void end(void)
{
    cli();
    sleep_enable();
    sleep_cpu();
}
#else
#define PER_TICK 40 /* the clock of 25 MHz, where an instruction takes 1 ns */
#define BATCH 1000
#define SYSTICK ((volatile uint32_t *)0xE000E010)

extern int main(void);
extern void initialise_monitor_handles(void);
extern uint32_t __bss_start__, __bss_end__;

void start(void)
{
    uint32_t *at;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* the unit for floating point */
    for (at = &__bss_start__; at < &__bss_end__; ++at) {
        *at = 0;
    }
    initialise_monitor_handles();
    main();
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[2] = {0x20010000u, (uintptr_t)start};

static void begin(void)
{
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5;
}

static uint32_t ticks(void)
{
    return SYSTICK[2];
}

static uint32_t between(uint32_t first, uint32_t last)
{
    return (first - last) & 0xFFFFFFu;
}

static void end(void)
{
    register int call __asm__("r0") = 0x18;
    register int reason __asm__("r1") = 0x20026;
    __asm__ volatile("bkpt 0xab" : : "r"(call), "r"(reason));
}
#endif

/* Steps of ten samples. */
static model_real command(int sample)
{
    static uint32_t number;
    if (sample == 0) {
        number = 1;
    }
    if (sample % 10 == 0) {
        number = number * 1664525u + 1013904223u;
    }
    return (model_real)((int)((number >> 16) % 2001u) - 1000) / 250.0f;
}

int main(void)
{
    uint32_t total = 0;
    static model_state state;
    model_real u[MODEL_INPUTS];
    model_real y[MODEL_OUTPUTS];
    int sample;
    begin();
    model_init(&state);
    for (sample = 0; sample < 1000; ++sample) {
        union {
            float value;
            uint32_t bits;
        } out;
        u[0] = command(sample);
        model_step(&state, u, y);
        out.value = (float)y[0];
        printf("%08lx\n", (unsigned long)out.bits);
    }
    model_init(&state);
    for (sample = 0; sample < 2000; sample += BATCH) {
        const int with = sample < 1000; /* then without the model, which is taken off */
        const uint32_t before = ticks();
        int k;
        for (k = 0; k < BATCH; ++k) {
            u[0] = command((sample + k) % 1000);
            if (with) {
                model_step(&state, u, y);
            }
        }
        total += with ? between(before, ticks()) : -between(before, ticks());
    }
    printf("cycles %lu\n", (unsigned long)(total * PER_TICK / 1000u));
    end();
    return 0;
}
