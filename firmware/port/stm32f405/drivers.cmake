# The peripheral drivers: in the image, and with a register bus of the test's on the host.
set(STM32F405_DRIVERS
    bxcan.c
    dip_switch.c
    encoder_timer.c
    gpio.c
    motor_adc.c
    servo_pwm.c
    tick_discipline.c
    tick_timer.c
    unique_id.c
    watchdog.c
)
list(TRANSFORM STM32F405_DRIVERS PREPEND ${CMAKE_CURRENT_LIST_DIR}/)
