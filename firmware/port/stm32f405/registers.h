/**
 * The registers of the STM32F405 that this port uses, and nothing else of the chip.
 *
 * X_BASE: address of peripheral X. X_REGISTER: address of a register; of peripherals that exist
 * several times, a function of the base address. X_REGISTER_FIELD: mask of a field, placed with
 * register_field() of register_bus.h. IRQ_X: number of an interrupt. All are 32 bits wide. Names
 * are those of ST's reference manual RM0090 rev. 19 and, for the core, of the ARMv7-M architecture
 * reference manual (ARM DDI 0403E). Values that a field may have stand with the driver.
 *
 * tests/tools/test_registers.py checks every line against ST's SVD description of the chip, and the
 * core's against ARM's documents.
 */
#ifndef REGISTERS_H
#define REGISTERS_H

/* Interrupt controller, DDI 0403E section B3.4. IPR: one byte an interrupt, STM32 has bits 7..4 */
#define NVIC_BASE 0xE000E000U
#define NVIC_ISER(word) (NVIC_BASE + 0x100U + 0x4U * (word))
#define NVIC_ICER(word) (NVIC_BASE + 0x180U + 0x4U * (word))
#define NVIC_ISPR(word) (NVIC_BASE + 0x200U + 0x4U * (word))
#define NVIC_ICPR(word) (NVIC_BASE + 0x280U + 0x4U * (word))
#define NVIC_IPR(word) (NVIC_BASE + 0x400U + 0x4U * (word))

/* System control block, DDI 0403E section B3.2 */
#define SCB_BASE 0xE000ED00U
#define SCB_CPUID (SCB_BASE + 0x00U)
#define SCB_ICSR (SCB_BASE + 0x04U)
#define SCB_ICSR_VECTACTIVE (0x1FFU << 0)
#define SCB_ICSR_VECTPENDING (0x1FFU << 12)
#define SCB_ICSR_PENDSTCLR (1U << 25)
#define SCB_ICSR_PENDSTSET (1U << 26)
#define SCB_ICSR_PENDSVCLR (1U << 27)
#define SCB_ICSR_PENDSVSET (1U << 28)
#define SCB_VTOR (SCB_BASE + 0x08U)
#define SCB_AIRCR (SCB_BASE + 0x0CU)
#define SCB_AIRCR_SYSRESETREQ (1U << 2)
#define SCB_AIRCR_PRIGROUP (0x7U << 8)
#define SCB_AIRCR_VECTKEY (0xFFFFU << 16)
#define SCB_SCR (SCB_BASE + 0x10U)
#define SCB_SCR_SLEEPDEEP (1U << 2)
#define SCB_CCR (SCB_BASE + 0x14U)
#define SCB_CCR_UNALIGN_TRP (1U << 3)
#define SCB_CCR_DIV_0_TRP (1U << 4)
#define SCB_CCR_BFHFNMIGN (1U << 8)
#define SCB_CCR_STKALIGN (1U << 9)
#define SCB_SHPR1 (SCB_BASE + 0x18U)
#define SCB_SHPR1_PRI_4 (0xFFU << 0)
#define SCB_SHPR1_PRI_5 (0xFFU << 8)
#define SCB_SHPR1_PRI_6 (0xFFU << 16)
#define SCB_SHPR2 (SCB_BASE + 0x1CU)
#define SCB_SHPR2_PRI_11 (0xFFU << 24)
#define SCB_SHPR3 (SCB_BASE + 0x20U)
#define SCB_SHPR3_PRI_14 (0xFFU << 16)
#define SCB_SHPR3_PRI_15 (0xFFU << 24)
#define SCB_SHCSR (SCB_BASE + 0x24U)
#define SCB_SHCSR_MEMFAULTENA (1U << 16)
#define SCB_SHCSR_BUSFAULTENA (1U << 17)
#define SCB_SHCSR_USGFAULTENA (1U << 18)
#define SCB_CFSR (SCB_BASE + 0x28U)
#define SCB_CFSR_IACCVIOL (1U << 0)
#define SCB_CFSR_DACCVIOL (1U << 1)
#define SCB_CFSR_MUNSTKERR (1U << 3)
#define SCB_CFSR_MSTKERR (1U << 4)
#define SCB_CFSR_MLSPERR (1U << 5)
#define SCB_CFSR_MMARVALID (1U << 7)
#define SCB_CFSR_IBUSERR (1U << 8)
#define SCB_CFSR_PRECISERR (1U << 9)
#define SCB_CFSR_IMPRECISERR (1U << 10)
#define SCB_CFSR_UNSTKERR (1U << 11)
#define SCB_CFSR_STKERR (1U << 12)
#define SCB_CFSR_LSPERR (1U << 13)
#define SCB_CFSR_BFARVALID (1U << 15)
#define SCB_CFSR_UNDEFINSTR (1U << 16)
#define SCB_CFSR_INVSTATE (1U << 17)
#define SCB_CFSR_INVPC (1U << 18)
#define SCB_CFSR_NOCP (1U << 19)
#define SCB_CFSR_UNALIGNED (1U << 24)
#define SCB_CFSR_DIVBYZERO (1U << 25)
#define SCB_HFSR (SCB_BASE + 0x2CU)
#define SCB_HFSR_VECTTBL (1U << 1)
#define SCB_HFSR_FORCED (1U << 30)
#define SCB_HFSR_DEBUGEVT (1U << 31)
#define SCB_MMFAR (SCB_BASE + 0x34U)
#define SCB_BFAR (SCB_BASE + 0x38U)
#define SCB_CPACR (SCB_BASE + 0x88U)
#define SCB_CPACR_CP10 (0x3U << 20)
#define SCB_CPACR_CP11 (0x3U << 22)

/* Floating-point context, DDI 0403E section B3.2 */
#define FPU_BASE 0xE000EF30U
#define FPU_FPCCR (FPU_BASE + 0x04U)
#define FPU_FPCCR_LSPEN (1U << 30)
#define FPU_FPCCR_ASPEN (1U << 31)
#define FPU_FPDSCR (FPU_BASE + 0x0CU)
#define FPU_FPDSCR_RMODE (0x3U << 22)
#define FPU_FPDSCR_FZ (1U << 24)
#define FPU_FPDSCR_DN (1U << 25)

/* System timer, DDI 0403E section B3.3 */
#define SYST_BASE 0xE000E010U
#define SYST_CSR (SYST_BASE + 0x00U)
#define SYST_CSR_ENABLE (1U << 0)
#define SYST_CSR_TICKINT (1U << 1)
#define SYST_CSR_CLKSOURCE (1U << 2)
#define SYST_CSR_COUNTFLAG (1U << 16)
#define SYST_RVR (SYST_BASE + 0x04U)
#define SYST_RVR_RELOAD (0xFFFFFFU << 0)
#define SYST_CVR (SYST_BASE + 0x08U)

/* Memory protection unit, DDI 0403E section B3.5 */
#define MPU_BASE 0xE000ED90U
#define MPU_TYPE (MPU_BASE + 0x00U)
#define MPU_TYPE_DREGION (0xFFU << 8)
#define MPU_CTRL (MPU_BASE + 0x04U)
#define MPU_CTRL_ENABLE (1U << 0)
#define MPU_CTRL_HFNMIENA (1U << 1)
#define MPU_CTRL_PRIVDEFENA (1U << 2)
#define MPU_RNR (MPU_BASE + 0x08U)
#define MPU_RBAR (MPU_BASE + 0x0CU)
#define MPU_RBAR_REGION (0xFU << 0)
#define MPU_RBAR_VALID (1U << 4)
#define MPU_RASR (MPU_BASE + 0x10U)
#define MPU_RASR_ENABLE (1U << 0)
#define MPU_RASR_SIZE (0x1FU << 1)
#define MPU_RASR_SRD (0xFFU << 8)
#define MPU_RASR_B (1U << 16)
#define MPU_RASR_C (1U << 17)
#define MPU_RASR_S (1U << 18)
#define MPU_RASR_TEX (0x7U << 19)
#define MPU_RASR_AP (0x7U << 24)
#define MPU_RASR_XN (1U << 28)

/* Cycle counter, DDI 0403E sections C1.6.5 and C1.8 */
#define DCB_BASE 0xE000EDF0U
#define DCB_DEMCR (DCB_BASE + 0x0CU)
#define DCB_DEMCR_TRCENA (1U << 24)
#define DWT_BASE 0xE0001000U
#define DWT_CTRL (DWT_BASE + 0x00U)
#define DWT_CTRL_CYCCNTENA (1U << 0)
#define DWT_CYCCNT (DWT_BASE + 0x04U)

#endif
